"""Messages from the daemon to the control process through a pipe.

A frame is four bytes of length and a pickle: both ends are the same program, and the pipe has one writer.
The arrays of a long trajectory are passed in shared memory and mapped by the reader, so that neither a later
stop nor a tick waits while megabytes are copied.
"""

from __future__ import annotations

import logging
import mmap
import os
import pickle
import struct
import tempfile
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Final

from contid.control.engine.cycle import OnEnd
from contid.control.process.shared_files import BULK_FILES
from contid.robot_file.load import LoadedFile
from contid.trajectory.timed import Trajectory

LENGTH: Final = struct.Struct("=I")
CHUNK: Final = 1 << 18


@dataclass(frozen=True, slots=True)
class RunSetup:
    """The first message on the pipe.

    Attributes:
        loaded: the robot file, checked already.
        rate_hz: ticks per second.
        ring: path of the ring to write.
        trajectory: timed rows to follow, or None.
        on_end: what to do at its end.
        attended: orders may follow, so the run does not end when every robot is in FAULT.
        armed: arm at once; False to connect and wait for `resume`.
        log_level: lowest level of log records in the recording.
    """

    loaded: LoadedFile
    rate_hz: float
    ring: Path
    trajectory: Trajectory | None
    on_end: OnEnd
    attended: bool
    armed: bool = True
    log_level: int = logging.INFO


@dataclass(frozen=True, slots=True)
class BulkMessage:
    """A message whose arrays are concatenated in a file, which the reader removes."""

    body: bytes
    path: str
    sizes: tuple[int, ...]

    def load(self) -> object:
        """The message, its arrays mapped read-only."""
        path = Path(self.path)
        with path.open("rb") as file:
            mapped = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        path.unlink()
        ends = list(accumulate(self.sizes, initial=0))
        views = [mapped[begin:end] for begin, end in pairwise(ends)]
        return pickle.loads(self.body, buffers=views)


def frame(message: object) -> bytes:
    """The bytes of a message on the pipe."""
    body = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    return LENGTH.pack(len(body)) + body


def to_shared_memory(message: object, folder: Path) -> BulkMessage | None:
    """Write the arrays of a message to a folder of shared memory; None without arrays or without space."""
    buffers: list[pickle.PickleBuffer] = []
    body = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL, buffer_callback=buffers.append)
    pieces = [buffer.raw() for buffer in buffers]
    if not sum(map(len, pieces)):
        return None
    front, back = BULK_FILES.split("*")
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
    return BulkMessage(body, path, tuple(map(len, pieces)))


class Inbox:
    """The read end of the pipe.

    Attributes:
        closed: the daemon has closed its end.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._buffer = bytearray()
        self.closed = False

    def poll(self) -> list[object]:
        """Complete messages, without blocking; reads at most one chunk, so that a tick stays short."""
        os.set_blocking(self._descriptor, False)
        try:
            chunk = os.read(self._descriptor, CHUNK)
        except BlockingIOError:
            # `wait` may have read more than its message.
            return self._complete()
        if not chunk:
            self.closed = True
        self._buffer += chunk
        return self._complete()

    def wait(self) -> object:
        """Wait for the next message.

        Raises:
            EOFError: the daemon closed the pipe.
        """
        os.set_blocking(self._descriptor, True)
        while not (messages := self._complete(at_most=1)):
            chunk = os.read(self._descriptor, CHUNK)
            if not chunk:
                raise EOFError("the daemon is gone")
            self._buffer += chunk
        return messages[0]

    def _complete(self, at_most: int = 1 << 30) -> list[object]:
        out: list[object] = []
        while len(out) < at_most and len(self._buffer) >= LENGTH.size:
            end = LENGTH.size + LENGTH.unpack_from(self._buffer)[0]
            if len(self._buffer) < end:
                break
            message = pickle.loads(self._buffer[LENGTH.size : end])
            del self._buffer[:end]
            out.append(message.load() if isinstance(message, BulkMessage) else message)
        return out
