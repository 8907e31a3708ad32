"""A tip that closes on an object until a force, and holds it: its state; the extra `contact` computes it.

The axes go on a straight line from the command at the begin to the target; a share s of it is where they are.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from contid.hal import Sample
from contid.targets import Actuation, Target


class SqueezeEnd(enum.Enum):
    """What a squeeze reports."""

    REACHED = "reached"  # the force is there; it is held
    LOST = "lost"  # the object is gone
    NOTHING = "nothing"  # the target came before the force
    PRESSED = "pressed"  # there was no free way to measure friction on
    WEAK = "weak"  # friction hides the force


@dataclass(frozen=True, slots=True)
class SqueezeReport:
    """The end of the closing or of the holding.

    Attributes:
        end: which.
        force_n: force of the tip along its motion then [N].
    """

    end: SqueezeEnd
    force_n: float


@dataclass(frozen=True, slots=True)
class Squeeze:
    """A tip that closes, or holds.

    Attributes:
        goal_n: force of the tip along its motion [N].
        start: command at the begin; empty before it.
        way: from there to the target.
        share: of the way, and its rate [1/s] and change of rate [1/s^2].
        free_s: time at constant speed.
        currents: filtered [A].
        free: mean currents of the free way, and of its first half [A].
        force_n: of the tip along its motion.
        touched: share of the way where half a touch was measured first, None before.
        stiffness: of what was touched [N per share], 0 before.
        sure_s: how long the force has been near, or gone.
        reached: it holds.
    """

    goal_n: float
    start: Actuation = ()
    way: Actuation = ()
    share: float = 0.0
    rate: float = 0.0
    change: float = 0.0
    free_s: float = 0.0
    currents: Actuation = ()
    free: tuple[Actuation, Actuation] = ((), ())
    force_n: float = 0.0
    touched: float | None = None
    stiffness: float = 0.0
    sure_s: float = 0.0
    reached: bool = False

    @property
    def reference(self) -> Actuation:
        """Where the axes have to be."""
        return actuation_at(self, self.share)


def actuation_at(squeeze: Squeeze, share: float) -> Actuation:
    """Where the axes are at a share of the way."""
    return tuple([a + share * b for a, b in zip(squeeze.start, squeeze.way, strict=True)])


class Squeezes(Protocol):
    """What computes a squeeze; the configuration of a robot whose currents show a force has it."""

    def why_not(self, config: Any, start: Actuation, target_in_base: Target) -> str:
        """Why a tip cannot close on an object at a target until a force; "" where it can."""

    def next_squeeze(
        self, config: Any, squeeze: Squeeze, samples: Sequence[Sample]
    ) -> tuple[Squeeze, SqueezeReport | None]:
        """The squeeze one period later, and the report of an end."""
