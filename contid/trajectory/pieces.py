"""Motions of one axis as pieces of constant jerk."""

from __future__ import annotations

from collections.abc import Sequence

#: Start time of a piece; position, velocity, acceleration and jerk there.
Knot = tuple[float, float, float, float, float]


def extend(knots: list[Knot], lasts_s: float, jerk: float) -> None:
    """Add a piece with a duration and a jerk; the last knot is its end."""
    begin_s, position, velocity, acceleration, _ = knots[-1]
    knots[-1] = (begin_s, position, velocity, acceleration, jerk)
    knots.append((begin_s + lasts_s, *_advanced(knots[-1], lasts_s), 0.0))


def state_at(knots: Sequence[Knot], time_s: float) -> tuple[float, float]:
    """Position and velocity; the last knot is at rest."""
    for knot in reversed(knots):
        if time_s >= knot[0]:
            break
    return _advanced(knot, time_s - knot[0])[:2] if knot is not knots[-1] else (knot[1], 0.0)


def _advanced(knot: Knot, by_s: float) -> tuple[float, float, float]:
    """Position, velocity and acceleration ``by_s`` into a piece."""
    _, position, velocity, acceleration, jerk = knot
    return (
        position + by_s * (velocity + by_s * (acceleration / 2.0 + by_s * jerk / 6.0)),
        velocity + by_s * (acceleration + by_s * jerk / 2.0),
        acceleration + by_s * jerk,
    )
