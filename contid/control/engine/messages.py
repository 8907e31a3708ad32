"""Messages of the daemon to the control process (`contid.control.process.pipe`).

``NAME`` of an order is its name in the ``order`` events of a recording, and its verb where it is a request of
the socket (`contid.control.orders`).
"""

from __future__ import annotations

import copyreg
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Final, TypeAlias

from contid.robot_file.base import StopPolicy
from contid.targets import Target, Vec3
from contid.trajectory.timed import Trajectory

#: Robots an order is for; None for all of them.
RobotNames: TypeAlias = tuple[str, ...] | None


@dataclass(frozen=True, slots=True)
class OrderToRobots:
    """Base of the orders that state nothing but which robots they are for."""

    NAME: ClassVar[str] = ""

    robots: RobotNames = None


class Hold(OrderToRobots):
    """Stop jerk-limited and stay; for all robots the trajectory pauses too."""

    NAME: ClassVar[str] = "hold"


class Resume(OrderToRobots):
    """Arm if need be and follow the source again."""

    NAME: ClassVar[str] = "resume"


class Follow(OrderToRobots):
    """Follow the source; refused where a robot is not armed, so that it undoes no stop on its way here."""

    NAME: ClassVar[str] = "follow"


class Estop(OrderToRobots):
    """Relax or vent now."""

    NAME: ClassVar[str] = "estop"


class ClearFault(OrderToRobots):
    """Clear the devices and the latch; nothing moves."""

    NAME: ClassVar[str] = "clear_fault"


class Recover(OrderToRobots):
    """Move robots that are outside their limits inside, slowly."""

    NAME: ClassVar[str] = "recover"


@dataclass(frozen=True, slots=True)
class Stop:
    """Stop by a policy, or by the robot file's policy for a reason (``on_end``, ``on_interrupt``, ...)."""

    NAME: ClassVar[str] = "stop"

    robots: RobotNames = None
    policy: StopPolicy | None = None
    reason: str = "on_interrupt"


@dataclass(frozen=True, slots=True)
class Grip:
    """Limit the effort of robots to a share (0 to 1) of that of the robot file; nothing else changes."""

    NAME: ClassVar[str] = "grip"

    share: float
    robots: RobotNames = None


@dataclass(frozen=True, slots=True)
class Goto:
    """Go to one target (world frame), then hold.

    Attributes:
        robot: its name.
        target: where it goes.
        until_force_n: the tip closes slowly and holds this force along its way; None for none.
    """

    NAME: ClassVar[str] = "goto"

    robot: str
    target: Target
    until_force_n: float | None = None


@dataclass(frozen=True, slots=True)
class Rows:
    """A row of a live stream: new targets by robot; None holds that robot until its next row."""

    NAME: ClassVar[str] = "rows"

    targets: Mapping[str, Target | None]


@dataclass(frozen=True, slots=True)
class Measured:
    """Where a tracker saw the tip of one robot; see `contid.control.tick.tip_feedback`.

    Attributes:
        robot: its name.
        tip_in_world: position [m].
        direction_in_world: unit tangent there, or None when only the position was measured.
        age_s: since it was captured.
    """

    NAME: ClassVar[str] = "measured"

    robot: str
    tip_in_world: Vec3
    direction_in_world: Vec3 | None = None
    age_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Play:
    """Follow a timed trajectory from its first row; the run goes on after its last.

    Attributes:
        trajectory: its rows.
        waits: at the first row, until `Go`.
    """

    NAME: ClassVar[str] = "play"

    trajectory: Trajectory
    waits: bool = False


@dataclass(frozen=True, slots=True)
class Start:
    """Let a trajectory that waits begin at a time; the control process makes it a `Go` at a tick.

    Attributes:
        at_s: time on CLOCK_MONOTONIC [s].
    """

    at_s: float


#: Why a `Go` is refused.
NOT_AT_START: Final = "not every robot waits at the first row of a trajectory; nothing began, all hold"


@dataclass(frozen=True, slots=True)
class Go:
    """A trajectory that waits begins in this tick; if not all robots have arrived, all hold instead.

    Attributes:
        at_s: when it was to begin, on CLOCK_MONOTONIC [s].
        began_s: when this tick started.
    """

    NAME: ClassVar[str] = "go"

    at_s: float
    began_s: float


@dataclass(frozen=True, slots=True)
class Begin:
    """A new live stream begins and replaces the earlier rows; the run goes on after its last."""

    NAME: ClassVar[str] = "begin"


@dataclass(frozen=True, slots=True)
class Mark:
    """Asks for an event ``mark`` with this number once every earlier message is carried out or refused.

    An odd one gives the messages behind it the number of the next mark, which is in their refusals.
    """

    number: int


@dataclass(frozen=True, slots=True)
class EndOfRows:
    """The live stream ended."""

    NAME: ClassVar[str] = "end"


@dataclass(frozen=True, slots=True)
class Finish:
    """Stop every robot (see `Stop`), then end the control process."""

    NAME: ClassVar[str] = "finish"

    policy: StopPolicy | None = None
    reason: str = "on_interrupt"


Message: TypeAlias = (
    Hold
    | Resume
    | Follow
    | Stop
    | Estop
    | ClearFault
    | Recover
    | Goto
    | Grip
    | Rows
    | Measured
    | Play
    | Start
    | Go
    | Begin
    | Mark
    | EndOfRows
    | Finish
)


def _proxy(plain: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(plain)


def _proxy_parts(proxy: MappingProxyType[Any, Any]) -> tuple[Any, ...]:
    return _proxy, (dict(proxy),)


# A target without extras shares one read-only mapping, which pickle does not know by itself.
copyreg.pickle(MappingProxyType, _proxy_parts)
