"""What extras check of motions that are known before they begin: distances of bodies, ropes between tips."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, TypeAlias

from contid.control.tick.config import RobotConfig
from contid.targets import Actuation, Tip, Vec3

#: Actuation and known force on the tip in the world [N], by robot.
Configuration: TypeAlias = Mapping[str, tuple[Actuation, Vec3]]


class MotionClearance(Protocol):
    """The robots of a file, moved as the tick moves them."""

    def approach(self, goals: Configuration) -> str:
        """Move robots to ``goals`` at once, from standstill; returns why that is too near, or ""."""

    def to(self, reached: Configuration, steps: Mapping[str, Actuation]) -> str:
        """Move on; returns why the configuration, or a stop from it with ``steps`` per tick, is too near."""


class ChecksClearance(Protocol):
    """What a robot file keeps apart."""

    def preflight(self, configs: Sequence[RobotConfig], seeds: Mapping[str, Actuation]) -> MotionClearance:
        """The check of motions that begin at ``seeds``; without one a robot is at its rest pose."""


class RopeState(Protocol):
    """A rope between two tips.

    Attributes:
        feasible: it can be so.
        reason: why not, "" when it can.
    """

    @property
    def feasible(self) -> bool:
        """See above."""

    @property
    def reason(self) -> str:
        """See above."""


class ChecksRope(Protocol):
    """A closed chain: two arms and the rope between their tips.

    Attributes:
        name: of the chain in its file.
        arms: names of its robots.
    """

    name: str
    arms: tuple[str, str]

    def check(self, tips: Mapping[str, Tip]) -> RopeState:
        """The rope between these tips of its arms; other entries are ignored."""
