"""Non-blocking stderr: output that a terminal, pipe or full disk does not accept at once is dropped.

Otherwise a stopped terminal (Ctrl-S), a paused pager or a closed pipe would block or end the process: the
daemon would serve neither Ctrl-C nor the socket, and a tick would be late.
"""

from __future__ import annotations

import io
import os
import select
import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

#: Bytes per write: a writable pipe accepts at least this many.
PIECE: Final = 512


class NonBlockingWriter(io.RawIOBase):
    """Writes to a descriptor only while it accepts data without blocking."""

    def __init__(self, descriptor: int) -> None:
        super().__init__()
        self._descriptor = descriptor
        self._poll = select.poll()
        self._poll.register(descriptor, select.POLLOUT)

    def writable(self) -> bool:
        """Yes."""
        return True

    def fileno(self) -> int:
        """The descriptor."""
        return self._descriptor

    def isatty(self) -> bool:
        """Whether the descriptor is a terminal."""
        return os.isatty(self._descriptor)

    def write(self, data: ReadableBuffer, /) -> int:
        """Write what is accepted at once; the rest is dropped and counts as written."""
        left = memoryview(data)
        size = len(left)
        with suppress(OSError):
            while left and self._poll.poll(0):
                left = left[os.write(self._descriptor, left[:PIECE]) :]
        return size


def make_stderr_nonblocking() -> None:
    """Make `sys.stderr` non-blocking, unless it was replaced (as in tests)."""
    stderr = sys.__stderr__
    if stderr is not None and sys.stderr is stderr:
        sys.stderr = io.TextIOWrapper(
            NonBlockingWriter(stderr.fileno()), stderr.encoding, "backslashreplace", write_through=True
        )
