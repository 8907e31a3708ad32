"""Messages to a person hold nobody up: what a terminal, a pipe or a full disk does not take is lost.

Without this a stopped terminal (Ctrl-S), a pager that does not read on or a reader that went away would hold,
or end, the process that writes: a daemon that hears neither Ctrl-C nor the socket, a tick that waits.
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

#: Bytes written at a time: a pipe that can be written has room for at least so many.
PIECE: Final = 512


class NonBlockingWriter(io.RawIOBase):
    """A descriptor that is written only while it takes something at once."""

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
        """Whether a person may be looking."""
        return os.isatty(self._descriptor)

    def write(self, data: ReadableBuffer, /) -> int:
        """Write what is taken at once; the rest is lost, and counts as written."""
        left = memoryview(data)
        size = len(left)
        with suppress(OSError):
            while left and self._poll.poll(0):
                left = left[os.write(self._descriptor, left[:PIECE]) :]
        return size


def make_stderr_nonblocking() -> None:
    """From now on messages on stderr are not waited for; a stand-in for stderr stays as it is."""
    stderr = sys.__stderr__
    if stderr is not None and sys.stderr is stderr:
        sys.stderr = io.TextIOWrapper(
            NonBlockingWriter(stderr.fileno()), stderr.encoding, "backslashreplace", write_through=True
        )
