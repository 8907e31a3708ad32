"""How messages cross the pipe from the daemon to the control process.

They are rare next to ticks (a row of a live stream, an order of a person), so they are pickled: both ends are
the same program, and the pipe has no other writer. A frame is four bytes of length and the pickle. The arrays
of a long trajectory do not go through the pipe: they are left in shared memory and mapped by the reader, so
that neither a stop behind them nor a tick has to wait for megabytes to be copied.
"""

from __future__ import annotations

import mmap
import os
import pickle
import struct
import tempfile
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Final

from contid.control.process.ring import ASIDE

LENGTH: Final = struct.Struct("=I")
CHUNK: Final = 1 << 18


@dataclass(frozen=True, slots=True)
class Aside:
    """A message whose arrays lie in a file, one behind the other; its reader removes it."""

    body: bytes
    path: str
    sizes: tuple[int, ...]

    def take(self) -> object:
        """The message; its arrays are mapped, not copied, and cannot be written."""
        path = Path(self.path)
        with path.open("rb") as file:
            mapped = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        path.unlink()
        ends = list(accumulate(self.sizes, initial=0))
        views = [mapped[begin:end] for begin, end in pairwise(ends)]
        return pickle.loads(self.body, buffers=views)


def frame(message: object) -> bytes:
    """A message as it goes over the pipe."""
    body = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    return LENGTH.pack(len(body)) + body


def aside(message: object, folder: Path) -> Aside | None:
    """Leave the arrays of a message in a folder of shared memory; None without arrays, or without room."""
    buffers: list[pickle.PickleBuffer] = []
    body = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL, buffer_callback=buffers.append)
    pieces = [buffer.raw() for buffer in buffers]
    if not sum(map(len, pieces)):
        return None
    front, back = ASIDE.split("*")
    try:
        descriptor, path = tempfile.mkstemp(back, f"{front}{os.getpid()}-", folder)
    except OSError:
        return None
    try:
        with os.fdopen(descriptor, "wb") as file:
            for piece in pieces:
                file.write(piece)
    except OSError:
        Path(path).unlink()
        return None
    return Aside(body, path, tuple(map(len, pieces)))


class Inbox:
    """The reading end of the pipe: never waits unless asked to, knows when the other side is gone."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._buffer = bytearray()
        self.closed = False

    def poll(self) -> list[object]:
        """Messages that have arrived completely; reads at most one chunk, so that a tick stays short."""
        os.set_blocking(self._descriptor, False)
        try:
            chunk = os.read(self._descriptor, CHUNK)
        except BlockingIOError:
            # What came together with the message that `wait` took is still here.
            return self._complete()
        if not chunk:
            self.closed = True
        self._buffer += chunk
        return self._complete()

    def wait(self) -> object:
        """The next message, waiting for it.

        Raises:
            EOFError: the other side closed the pipe instead.
        """
        os.set_blocking(self._descriptor, True)
        while len(self._buffer) < LENGTH.size or len(self._buffer) < LENGTH.size + self._wanted():
            chunk = os.read(self._descriptor, CHUNK)
            if not chunk:
                raise EOFError("the daemon is gone")
            self._buffer += chunk
        return self._complete(at_most=1)[0]

    def _wanted(self) -> int:
        return int(LENGTH.unpack_from(self._buffer)[0])

    def _complete(self, at_most: int = 1 << 30) -> list[object]:
        out: list[object] = []
        while len(out) < at_most and len(self._buffer) >= LENGTH.size:
            end = LENGTH.size + self._wanted()
            if len(self._buffer) < end:
                break
            message = pickle.loads(self._buffer[LENGTH.size : end])
            del self._buffer[:end]
            out.append(message.take() if isinstance(message, Aside) else message)
        return out
