"""What the daemon may tell the control process, and how it crosses the pipe.

Messages are rare next to ticks (a row of a live stream, an order of a person), so they are pickled: both ends
are the same program, and the pipe has no other writer. A frame is four bytes of length and the pickle. The
arrays of a long trajectory do not go through the pipe: they are left in shared memory and mapped by the
reader, so that neither a stop behind them nor a tick has to wait for megabytes to be copied.
"""

from __future__ import annotations

import copyreg
import mmap
import os
import pickle
import struct
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, TypeAlias

from contid.control.ring import ASIDE
from contid.description.base import StopPolicy
from contid.targets import Target, Vec3
from contid.trajectory.timed import Trajectory

LENGTH: Final = struct.Struct("=I")
CHUNK: Final = 1 << 18

#: Robots an order is for; None for all of them.
Who: TypeAlias = tuple[str, ...] | None


@dataclass(frozen=True, slots=True)
class Hold:
    """Stop jerk-limited and stay; for all robots the trajectory pauses too."""

    robots: Who = None


@dataclass(frozen=True, slots=True)
class Resume:
    """Arm if need be and follow the source again."""

    robots: Who = None


@dataclass(frozen=True, slots=True)
class Stop:
    """Stop by a policy, or by the robot file's policy for a reason (``on_end``, ``on_interrupt``, ...)."""

    robots: Who = None
    policy: StopPolicy | None = None
    reason: str = "on_interrupt"


@dataclass(frozen=True, slots=True)
class Estop:
    """Relax or vent now."""

    robots: Who = None


@dataclass(frozen=True, slots=True)
class ClearFault:
    """Clear the devices and the latch; nothing moves."""

    robots: Who = None


@dataclass(frozen=True, slots=True)
class Goto:
    """Go to one target (world frame), then hold."""

    robot: str
    target: Target


@dataclass(frozen=True, slots=True)
class Rows:
    """A row of a live stream: new targets by robot; None holds that robot until its next row."""

    targets: Mapping[str, Target | None]


@dataclass(frozen=True, slots=True)
class Measured:
    """Where a tracker saw the tip of one robot; see `contid.control.tip_feedback`.

    Attributes:
        robot: its name.
        tip_in_world: position [m].
        direction_in_world: unit tangent there, or None when only the position was measured.
        age_s: since it was captured.
    """

    robot: str
    tip_in_world: Vec3
    direction_in_world: Vec3 | None = None
    age_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Play:
    """Follow a timed trajectory from its first row; the run goes on after its last."""

    trajectory: Trajectory


@dataclass(frozen=True, slots=True)
class Begin:
    """A new live stream begins: the rows before are forgotten; the run goes on after its last."""


@dataclass(frozen=True, slots=True)
class Mark:
    """Answered with an event ``mark``: everything sent before it was obeyed, or refused by an event."""

    number: int


@dataclass(frozen=True, slots=True)
class End:
    """The live stream ended."""


@dataclass(frozen=True, slots=True)
class Finish:
    """Stop every robot (see `Stop`), then end the control process."""

    policy: StopPolicy | None = None
    reason: str = "on_interrupt"


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


Message: TypeAlias = (
    Hold | Resume | Stop | Estop | ClearFault | Goto | Rows | Measured | Play | Begin | Mark | End | Finish
)


def _proxy(plain: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(plain)


def _proxy_parts(proxy: MappingProxyType[Any, Any]) -> tuple[Any, ...]:
    return _proxy, (dict(proxy),)


# A target without extras shares one read-only mapping, which pickle does not know by itself.
copyreg.pickle(MappingProxyType, _proxy_parts)


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
