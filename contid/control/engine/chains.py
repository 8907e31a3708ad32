"""Closed chains: arms whose tips hold one rope, as the extra `ropes` checks them and keeps them together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from contid.control.engine.cycle import Sink
from contid.control.engine.exchange import Exchange
from contid.control.engine.messages import RobotNames
from contid.control.engine.robots import Robots
from contid.control.engine.stages import TickStage
from contid.control.tick.preflight.kept_apart import ChecksRope
from contid.targets import Target


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
