"""Play and friction of drives, such as tendons: commands lead them, so that what was asked for arrives.

Play: an axis with the half width r delivers f, which follows the device u only at the edges of the play::

    f = clip(f before, u - r, u + r)        u = command + offset

The offset goes to +r or -r with the sense of motion and stays at rest, so that f is the command. The sense
turns when the command has come back from f by more than a part of r (`TURN`): answers to a noisy tracker
would else move the devices by 2 r in every tick. At a turn f is off by up to that part. Friction in the bends
of a tendon robot: the lead of `contid.kinematics.tendon.capstan`, for which the sense of sliding of every
tendon is kept.

A turn of direction takes up either at most at the velocity limit of an axis, on top of its motion. Leads are
part of the robot's state, as replay needs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from contid.control.tick.limits import AxisLimits
from contid.records import record
from contid.targets import Actuation

if TYPE_CHECKING:
    from contid.kinematics.tendon.capstan import CapstanLead


@record(frozen=True, slots=True)
class Lead:
    """What is added to the commands of a robot.

    Attributes:
        added: to every axis [m or Pa]; empty: nothing.
        play: the part that leads play.
        friction: the part that leads friction in the bends, of the tendons.
        slides: sense of sliding of the tendons in the sections.
        senses: of motion of every axis for its play: 1 up, -1 down, 0 before the first motion.
        delivered: what the axes have behind their play or hysteresis [m or Pa]; empty without any.
    """

    added: Actuation = ()
    play: Actuation = ()
    friction: Actuation = ()
    slides: Actuation = ()
    senses: Actuation = ()
    delivered: Actuation = ()

    def ahead(self, command: Actuation) -> Actuation:
        """By what the devices are ahead of the axes; empty without a lead."""
        if not self.delivered:
            return self.added
        return tuple([u - f for u, f in zip(led(command, self.added), self.delivered, strict=True)])


NO_LEAD: Final = Lead()
#: Way back that turns the sense of motion, as a part of the half width of the play.
TURN: Final = 0.1
#: A step that is rounding, as a share of the greatest: answers to a target that stands differ by 1e-18 m.
_STILL: Final = 1e-9


def next_lead(
    play: Actuation | None,
    capstan: CapstanLead | None,
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
        command: of this tick [m or Pa].
        increments: by which it differs from that of the tick before.
        limits: of the axes; their step bounds the change of each part.
    """
    offsets, senses, delivered = before.play, before.senses, before.delivered
    if play is not None:
        last = delivered or tuple([new - step for new, step in zip(command, increments, strict=True)])
        senses = next_senses(play, senses, last, command)
        offsets = taken_up(play, offsets, senses, increments, limits)
        delivered = held(play, last, led(command, offsets))
    friction, slides = before.friction, before.slides
    if capstan is not None and (friction or any(increments)):
        slides = capstan.slides(slides, command, increments)
        goal = capstan.lead(command, slides).tolist()
        friction = together(friction or (0.0,) * len(goal), goal, limits)
    added = offsets or (0.0,) * len(command)
    if friction:
        added = (*[a + b for a, b in zip(added, friction, strict=False)], *added[len(friction) :])
    return Lead(added, offsets, friction, slides, senses, delivered)


def next_senses(
    half_width: Sequence[float], senses: Sequence[float], delivered: Sequence[float], command: Actuation
) -> Actuation:
    """Senses of motion after a tick: a sense turns when the command has come back from what was delivered."""
    after = []
    for r, sense, f, new in zip(half_width, senses or (0.0,) * len(command), delivered, command, strict=True):
        gap = new - f
        turns = gap * sense < -TURN * r if sense else abs(gap) > TURN * r
        after.append(math.copysign(1.0, gap) if turns else sense)
    return tuple(after)


def held(half_width: Sequence[float], delivered: Sequence[float], devices: Sequence[float]) -> Actuation:
    """What axes with play deliver after their devices moved: the play operator."""
    return tuple([min(max(f, u - r), u + r) for r, f, u in zip(half_width, delivered, devices, strict=True)])


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
    senses: Sequence[float],
    increments: Sequence[float],
    limits: Sequence[AxisLimits],
) -> Actuation:
    """Offsets after a tick [m or Pa].

    Args:
        half_width: r of every axis; 0 is none.
        offsets: of the tick before; empty before the first.
        senses: of motion.
        increments: of the commands in this tick.
        limits: of the axes; their step bounds the change.
    """
    before = offsets or (0.0,) * len(half_width)
    after = []
    for r, offset, sense, increment, axis in zip(half_width, before, senses, increments, limits, strict=True):
        still = sense == 0.0 or abs(increment) <= _STILL * axis.step
        goal = offset if still else sense * r
        after.append(min(max(goal, offset - axis.step), offset + axis.step))
    return tuple(after)


def led(command: Actuation, added: Actuation) -> Actuation:
    """What the transmission gets for a command; the command itself without a lead."""
    return tuple([a + b for a, b in zip(command, added, strict=True)]) if added else command
