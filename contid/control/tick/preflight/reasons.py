"""Why a robot cannot follow a path, and what to do about it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import starmap
from typing import Final

from contid.control.tick.config import RobotConfig
from contid.targets import Solution, Target
from contid.units import m_to_mm

#: A target this far beyond the reach still counts as met: the curve between two rows on the boundary of the
#: reach bulges out of it by micrometres [m].
NEAR_M: Final = 1e-5


@dataclass(frozen=True, slots=True)
class PathFinding:
    """Why a robot cannot follow the way to a row.

    Attributes:
        message: the reason, as printed.
        slowdown: at least how many times slower this part of the path has to be; 0 when it is out of reach.
        residual_m: of a target out of reach, else 0 [m].
        row: index of the row.
    """

    message: str
    slowdown: float = 0.0
    residual_m: float = 0.0
    row: int = 0


def too_fast(config: RobotConfig, axis: int, step: float, change: float) -> PathFinding:
    """Speed and acceleration that an axis needs; of the two, the one that asks for the greater slowdown.

    A path played s times slower needs s times less speed and s^2 times less acceleration.

    Args:
        config: of the robot.
        axis: index of the axis.
        step: greatest change of it in a tick [m, Pa or rad].
        change: greatest change of its step.
    """
    unit, per_si = config.quantities[axis].unit, config.quantities[axis].per_si
    velocity_limit, acceleration_limit = config.velocity[axis], config.acceleration[axis]
    speed, acceleration = step / config.period_s, change / config.period_s**2
    by_speed, by_acceleration = speed / velocity_limit, math.sqrt(acceleration / acceleration_limit)
    needs = [
        (by_speed, f"{speed * per_si:.4g} {unit}/s, limit {velocity_limit * per_si:.4g}"),
        (by_acceleration, f"{acceleration * per_si:.4g} {unit}/s2, limit {acceleration_limit * per_si:.4g}"),
    ]
    slowdown = max(1.0, by_speed, by_acceleration)
    over = " and ".join(text for share, text in needs if share > 1.0)
    # The axis may also be within its rates, but brake before the end of its travel, or still be behind from
    # earlier rows.
    if not over:
        over = f"falls behind at {' and '.join(text for _, text in needs)}"
    else:
        over = f"needs {over}"
    return PathFinding(f"{config.axes[axis]} {over}: {slower(slowdown)}", slowdown=slowdown)


def jump(config: RobotConfig, axis: int, by: float, target: Target) -> PathFinding:
    """The answer of the model changes at once, for an axis by a length, pressure or angle in SI."""
    unit, per_si = config.quantities[axis].unit, config.quantities[axis].per_si
    far = f"{abs(by) * per_si:.3g} {unit} at {shown(config, target)}"
    message = f"{config.axes[axis]} would have to jump by {far}, at any speed"
    return PathFinding(f"{message}: the answers of the model change at once; {_AROUND}")


def undecided(config: RobotConfig, target: Target) -> PathFinding:
    """Rounding decides which answer of the model is followed from a target on."""
    where = shown(config, target)
    return PathFinding(f"{config.name}: at {where} rounding decides between two answers; {_AROUND}")


#: Remedy for answers that are not continuous.
_AROUND: Final = "lead the path around it, or state a direction"


def slower(slowdown: float) -> str:
    """What to do about a path that is too fast by a factor; 1 stands for an unknown factor."""
    return f"slow down at least {rounded_up(slowdown)} times" if slowdown > 1.0 else "slow down"


def rounded_up(factor: float) -> str:
    """A factor with two digits, never below it."""
    digits = 10.0 ** (1 - math.floor(math.log10(factor)))
    return f"{math.ceil(factor * digits * (1.0 - 1e-9)) / digits:g}"


def explain(config: RobotConfig, target: Target, solution: Solution) -> str:
    """Which columns of which robot, which limit, and by how much."""
    beyond = _beyond(config, target)
    if beyond and solution.residual_m <= NEAR_M:
        return f"{config.name}: {'; '.join(beyond)}"
    where = "actuation" if target.actuation is not None else "shape" if target.arcs is not None else "tip"
    limits = f" (limited by {', '.join(solution.limited_by)})" if solution.limited_by else ""
    note = f"; {solution.note}" if solution.note else ""
    miss = "" if target.tip_m is None else f" by {m_to_mm(solution.residual_m):.6g} mm"
    return f"{config.name}: {where} {shown(config, target)} is out of reach{miss}{limits}{note}"


def _beyond(config: RobotConfig, target: Target) -> list[str]:
    """The extra axes that a target sends beyond their limits, with how far."""
    found = []
    for k in range(len(config.axes) - config.extra_axes, len(config.axes)):
        name, limits, quantity = config.axis_names[k], config.limits[k], config.quantities[k]
        value = target.extra.get(name)
        if value is None or limits.lower <= value <= limits.upper:
            continue
        end = limits.upper if value > limits.upper else limits.lower
        at, by, limit = (quantity.from_si(each) for each in (value, abs(value - end), end))
        unit = quantity.unit
        found.append(f"{name} {at:.6g} {unit} is {by:.6g} {unit} beyond its limit of {limit:.6g} {unit}")
    return found


def shown(config: RobotConfig, target: Target) -> str:
    """A target as it is written, with its unit."""
    if target.actuation is not None:
        unit = config.quantity.unit
        return "(" + ", ".join(f"{v * config.quantity.per_si:.6g}" for v in target.actuation) + f") {unit}"
    if target.arcs is not None:
        sections = zip(*(iter(target.arcs),) * 3, strict=True)
        return "(" + "; ".join(starmap(_bend, sections)) + ")"
    return "(" + ", ".join(f"{m_to_mm(v):.6g}" for v in target.tip_m or ()) + ") mm"


def _bend(u: float, v: float, length_m: float) -> str:
    """A bend by its components [rad], and the length of the section [m]; 0 for none."""
    bend, azimuth = math.degrees(math.hypot(u, v)), math.degrees(math.atan2(v, u))
    long = f", {m_to_mm(length_m):.6g} mm long" if length_m else ""
    return f"{bend:.6g} deg towards {azimuth:.6g} deg{long}"
