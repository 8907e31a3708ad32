"""Play and friction of drives, such as tendons: commands lead them, so that what was asked for arrives.

Play: an axis with the half width r delivers ``command + offset -+ r`` while it moves up or down. The offset
that is added to commands goes to +r or -r with the last direction of motion and stays at rest, the inverse of
the play operator (`contid.kinematics.tendon.friction`). Friction in the bends of a tendon robot: the lead of
`contid.kinematics.tendon.capstan`, for which the sense of sliding of every tendon is kept.

A turn of direction takes up either at most at the velocity limit of an axis, on top of its motion. Leads are
part of the robot's state, as replay needs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from contid.control.tick.limits import AxisLimits
from contid.kinematics.array import Array
from contid.targets import Actuation


class Capstan(Protocol):
    """Interface of `contid.kinematics.tendon.capstan.CapstanLead`."""

    def slides(self, before: Actuation, pulls: Actuation, steps: Actuation) -> Actuation:
        """Sense of sliding of every tendon in every section after a step."""
        ...

    def lead(self, pulls: Actuation, slides: Actuation) -> Array:
        """What is added to the pulls [m]."""
        ...


@dataclass(frozen=True, slots=True)
class Lead:
    """What is added to the commands of a robot.

    Attributes:
        added: to every axis [m or Pa]; empty: nothing.
        play: the part that leads play.
        friction: the part that leads friction in the bends, of the tendons.
        slides: sense of sliding of the tendons in the sections.
        chambers: pressures that the chambers of regulators with hysteresis hold [Pa].
    """

    added: Actuation = ()
    play: Actuation = ()
    friction: Actuation = ()
    slides: Actuation = ()
    chambers: Actuation = ()


NO_LEAD: Final = Lead()
#: A step that is rounding, as a share of the greatest: answers to a target that stands differ by 1e-18 m.
_STILL: Final = 1e-9


def next_lead(
    play: Actuation | None,
    capstan: Capstan | None,
    before: Lead,
    command: Actuation,
    increments: Actuation,
    limits: Sequence[AxisLimits],
) -> Lead:
    """The lead after a tick.

    Args:
        play: half width of every axis; None without.
        capstan: of the robot; None without.
        before: of the tick before.
        command: of this tick, and ``increments`` of it.
        increments: of the commands in this tick.
        limits: of the axes; their step bounds the change of each part.
    """
    offsets = taken_up(play, before.play, increments, limits) if play is not None else ()
    friction, slides = before.friction, before.slides
    if capstan is not None and (friction or any(increments)):
        slides = capstan.slides(slides, command, increments)
        goal = capstan.lead(command, slides).tolist()
        friction = together(friction or (0.0,) * len(goal), goal, limits)
    added = offsets or (0.0,) * len(command)
    if friction:
        added = (*[a + b for a, b in zip(added, friction, strict=False)], *added[len(friction) :])
    return Lead(added, offsets, friction, slides)


def together(before: Sequence[float], goal: Sequence[float], limits: Sequence[AxisLimits]) -> Actuation:
    """On a straight line from leads to other ones, as far as the step of every axis allows.

    Tendons that keep a backbone in balance have to change together.
    """
    share = 1.0
    for old, new, axis in zip(before, goal, limits, strict=False):
        if abs(new - old) > axis.step:
            share = min(share, axis.step / abs(new - old))
    if share == 1.0:
        return tuple(goal)
    return tuple([old + share * (new - old) for old, new in zip(before, goal, strict=True)])


def taken_up(
    half_width: Sequence[float],
    offsets: Sequence[float],
    increments: Sequence[float],
    limits: Sequence[AxisLimits],
) -> Actuation:
    """Offsets after a tick [m or Pa].

    Args:
        half_width: r of every axis; 0 is none.
        offsets: of the tick before; empty before the first.
        increments: of the commands in this tick.
        limits: of the axes; their step bounds the change.
    """
    before = offsets or (0.0,) * len(half_width)
    after = []
    for r, offset, increment, axis in zip(half_width, before, increments, limits, strict=True):
        still = abs(increment) <= _STILL * axis.step
        goal = offset if still else math.copysign(r, increment)
        after.append(min(max(goal, offset - axis.step), offset + axis.step))
    return tuple(after)


def led(command: Actuation, added: Actuation) -> Actuation:
    """What the transmission gets for a command; the command itself without a lead."""
    return tuple([a + b for a, b in zip(command, added, strict=True)]) if added else command
