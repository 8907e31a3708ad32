"""Stages of a tick: what a robot file asks for besides targets, the ticks of its robots and the exchange.

`contid.control.engine.engine.Engine.cycle` calls `TickStage.before` ahead of the ticks of the robots,
`TickStage.after` behind them, and `TickStage.settle` behind the exchange with the buses. A stage is built
only where a robot file asks for it, and only the methods that its class defines are called.

A stage of an extra is found as a driver is: a function `BuildStage` in the entry-point group
``contid.stages``, under the name that `contid.robot_file.robot.RobotDescription.stages` gives. The core
imports no extra.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Final, Protocol, TypeAlias

from contid.control.engine.cycle import Sink, Timing
from contid.control.engine.exchange import Exchange
from contid.control.engine.messages import RobotNames
from contid.control.engine.robots import Robots
from contid.control.tick.preflight.kept_apart import ChecksClearance, ChecksRope
from contid.control.tick.robot_tick import TickResult
from contid.errors import ContidError
from contid.targets import Target

ENTRY_POINT_GROUP: Final = "contid.stages"

#: Targets of a tick by robot, in the world frame.
Targets = Mapping[str, Target | None]


class TickStage:
    """One stage; a class defines the methods that it needs.

    A method that raises is a fault of the robots of the stage: they stop by their policy, the others go on.

    Attributes:
        robots: indices of the robots that the stage works for.
    """

    robots: Sequence[int]

    def before(self, targets: Targets, timing: Timing, now_s: float) -> Targets:
        """Before the ticks of the robots: the targets, changed or not.

        Args:
            targets: of this tick.
            timing: of this tick, on the clock of the buses.
            now_s: of this tick, in the time of the robots.
        """
        return targets

    def after(self, outcomes: list[TickResult], targets: Targets, now_s: float) -> None:
        """After the ticks of the robots and before the exchange: may replace their results in the list."""

    def settle(self, now_s: float) -> None:
        """After the exchange, at the time of the next tick: may change the states of the robots."""

    def goto(self, robot: str, target: Target) -> Target:
        """A single target that was ordered, changed or not."""
        return target

    def cancel(self) -> None:
        """An order arrived: what the stage had begun by itself is not carried on."""


class React(Protocol):
    """Lets a robot react to a contact by its policy."""

    def __call__(self, index: int, found_s: float, what: str, now_s: float) -> None:
        """React now.

        Args:
            index: of the robot.
            found_s: when the contact was measured, in the time of the robots.
            what: touched it, for the message of a fault.
            now_s: of this tick.
        """


class ReactsToContacts(TickStage):
    """The stage of the robots that look for contacts.

    Attributes:
        going_back: targets of the robots on their way back by their index, None while they brake. A robot is
            in it from a contact until it is back; only then the end of its goto is reported.
    """

    going_back: Mapping[int, Target | None]

    def react(self, index: int, found_s: float, what: str, now_s: float) -> None:
        """See `React`."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class EngineParts:
    """What a stage of an extra may use of the engine.

    Attributes:
        robots: all of them, with their states and measured tips; a stage that estimates the force on a tip
            writes it to `Robots.loads`, from which it is recorded.
        exchange: with their devices.
        react: to contacts; None where no robot looks for any.
        sink: of the events.
        follows_trajectory: True while the source of targets is a trajectory, whose rows were checked before.
    """

    robots: Robots
    exchange: Exchange
    react: React | None
    sink: Sink
    follows_trajectory: Callable[[], bool]


class BodyClearance(ChecksClearance, Protocol):
    """What a robot file keeps apart, in the tick too: the extra `clearance` builds it."""

    def stage(self, parts: EngineParts) -> TickStage:
        """The stage that keeps the bodies apart."""


class ArmsTogether(TickStage):
    """The closed chains of a file; this class itself is for files without any."""

    robots: Sequence[int] = ()

    @property
    def has_chains(self) -> bool:
        """True for a file with chains; the ticks of others make no calls here."""
        return False

    def concerns(self, robot: str) -> bool:
        """True for the arms of chains."""
        return False

    def keep_goto(self, robot: str, target: Target) -> None:
        """Keep a goto of an arm until `begin_gotos` checks all of one tick together."""

    def begin_gotos(self, now_s: float) -> None:
        """Begin the gotos of one tick, of a chain all or none; refuse forbidden ones."""

    def stopped(self, who: RobotNames, now_s: float) -> None:
        """After an order that stops robots: their chains hold, and forbidden ways to rest poses end."""


class ChainGuards(Protocol):
    """The guards of the closed chains of a file, and what keeps their arms together in the tick."""

    guards: Sequence[ChecksRope]

    def monitor(self, robots: Robots, exchange: Exchange, sink: Sink) -> ArmsTogether:
        """The stage for these robots."""


#: Builds the stage of the robot with an index, None when it needs none.
BuildStage: TypeAlias = Callable[[int, EngineParts], TickStage | None]


def load_stage(name: str) -> BuildStage:
    """Import the builder of a stage.

    Raises:
        ContidError: no stage of this name is installed.
    """
    for point in entry_points(group=ENTRY_POINT_GROUP, name=name):
        try:
            build: BuildStage = point.load()
        except ModuleNotFoundError as error:
            raise ContidError(f"the stage {name!r} of a robot file needs {error.name}: install it") from error
        return build
    raise ContidError(f"the robot file asks for the stage {name!r}, which is not installed")


def stages_of_extras(parts: EngineParts) -> list[TickStage]:
    """The stages of extras that the robots ask for, in the order of the robots.

    Raises:
        ContidError: one is not installed.
    """
    stages = []
    for index, config in enumerate(parts.robots.configs):
        for name in config.stages:
            if (stage := load_stage(name)(index, parts)) is not None:
                stages.append(stage)
    return stages


def with_method(stages: Sequence[TickStage], method: str) -> tuple[TickStage, ...]:
    """The stages whose class defines a method of `TickStage` itself."""
    inherited = getattr(TickStage, method)
    return tuple(stage for stage in stages if getattr(type(stage), method) is not inherited)
