"""What a controller of `Procedures.servo` gets and returns; the loop is in the extra `library`."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias


@dataclass(frozen=True, slots=True)
class ServoState:
    """Input of a controller in one period.

    Attributes:
        step: number of this period, from 0.
        time_s: time since the first period [s].
        robots: newest telemetry by robot: ``state``, ``fault``, ``tip_mm``, ``command``, ``measured``.
        tick: tick of that telemetry.
        refused: why the last set-point was refused (its robots hold), "" otherwise.
        reached: columns of the last set-point whose values the daemon replaced by those of the nearest
            point in reach, with their values there; empty otherwise.
    """

    step: int
    time_s: float
    robots: Mapping[str, Any]
    tick: int
    refused: str
    reached: Mapping[str, float] = field(default_factory=dict)


SetPoint: TypeAlias = Mapping[str, float] | None
#: Returns columns of a trajectory with their values, or None to end.
Controller: TypeAlias = Callable[[ServoState], SetPoint | Awaitable[SetPoint]]


@dataclass(frozen=True, slots=True)
class ServoReport:
    """Statistics of a servo loop.

    Attributes:
        steps: set-points sent.
        skipped: periods without a set-point, because the controller or the daemon was late.
        refused: set-points that were refused.
        messages: about the first of them.
        round_trip_ms: mean time from sending a set-point to its acceptance; over a network, where
            some set-points are under way at a time, to the sending of the next one.
        max_round_trip_ms: the longest.
    """

    steps: int
    skipped: int
    refused: int
    messages: tuple[str, ...]
    round_trip_ms: float
    max_round_trip_ms: float
