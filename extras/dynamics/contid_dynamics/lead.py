"""Commands that lead a timed path by what the robot lags: dead time, first-order answer, first mode.

The tip follows a command u through a dead time, a lag T and a mode of undamped rate w and ratio z. Without
the dead time a path y(t) of the axes comes out of

    u = (1 + T s) (1 + 2 z s / w + s^2 / w^2) y

with s for the derivative. That is a sum of derivatives of the path up to the third: no equation is solved, so
it is stable where the robot is. Dead times are not made up for: axes with a shorter one wait, and the whole
path comes that of the slowest axis later.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.robot import RobotDescription
from contid.robot_file.tendon.robot import TendonRobot
from contid_dynamics.body import per_axis
from contid_dynamics.report import pose_modes

#: Degree of the curve through the rows, whose third derivative is continuous.
_DEGREE: Final = 5
#: Share of its range up to which an axis that leads beyond a limit is held at it.
_HELD: Final = 5e-3


@dataclass(frozen=True)
class Answer:
    """How a robot follows its commands.

    Attributes:
        delay_s: dead time of every axis.
        lag_s: time constant of every axis.
        frequency_hz: undamped frequency of the first mode; infinite to leave the body out.
        ratio: its damping ratio.
    """

    delay_s: tuple[float, ...]
    lag_s: tuple[float, ...]
    frequency_hz: float = math.inf
    ratio: float = 0.0


def answer_of(robot: RobotDescription, pose: Sequence[float], body: bool = True) -> Answer:
    """Of a robot with ``dynamics``, with the mode at a pose [m or Pa].

    Raises:
        ContidError: it has no ``dynamics``, or shapes its commands itself.
    """
    if not isinstance(robot, (Cosserat, TendonRobot)) or robot.dynamics is None:
        raise ContidError("dynamics: missing; the lead of a path needs delay_ms, lag_ms and the masses of it")
    if robot.rates.shape is not None:
        raise ContidError("rates.shape delays what a lead has made up for; leave it out for a led trajectory")
    axes = len(robot.axis_names)
    delay_s, lag_s = (
        tuple(1e-3 * each for each in per_axis(given, axes))
        for given in (robot.dynamics.delay_ms, robot.dynamics.lag_ms)
    )
    if not body:
        return Answer(delay_s, lag_s)
    first = pose_modes(robot, pose, 1).modes[0]
    return Answer(
        delay_s, lag_s, first.frequency_hz / math.sqrt(1.0 - min(first.ratio, 0.9) ** 2), first.ratio
    )


def led(path: Array, period_s: float, answer: Answer, times_s: Array | None = None) -> Array:
    """Commands after which the robot does a path, later by its greatest dead time.

    Args:
        path: of the axes ``(rows, axes)``, from rest to rest; between its rows it is a curve of degree 5.
        period_s: between two commands.
        answer: of the robot.
        times_s: of the rows, from 0 on; one per command by default.

    Returns:
        Commands ``(ticks, axes)``; rows may be more than those of the path by the waiting of faster axes.

    Raises:
        ContidError: the path has too few rows.
    """
    from scipy.interpolate import make_interp_spline

    if len(path) <= _DEGREE:
        raise ContidError(f"a path of {len(path)} rows has no lead; at least {_DEGREE + 1} are needed")
    rate = 2.0 * math.pi * answer.frequency_hz
    first, second = 2.0 * answer.ratio / rate, rate**-2
    longest = max(answer.delay_s)
    knots = period_s * np.arange(len(path)) if times_s is None else times_s
    rest = np.repeat(path[:1], _DEGREE, axis=0), np.repeat(path[-1:], _DEGREE, axis=0)
    end_s, beyond = float(knots[-1]), np.arange(1, _DEGREE + 1)
    before, after = (knots[1] - knots[0]) * beyond, (knots[-1] - knots[-2]) * beyond
    times = np.concatenate((-before[::-1], knots, end_s + after))
    ticks = math.ceil((end_s + longest - min(answer.delay_s)) / period_s - 1e-9) + 1
    out = np.empty((ticks, path.shape[1]))
    curve = make_interp_spline(times, np.vstack((rest[0], path, rest[1])), k=_DEGREE)
    for axis, (delay_s, lag_s) in enumerate(zip(answer.delay_s, answer.lag_s, strict=True)):
        at = np.clip(period_s * np.arange(ticks) - (longest - delay_s), 0.0, end_s)
        # (1 + T s) (1 + a s + b s^2) = 1 + (T + a) s + (T a + b) s^2 + T b s^3
        shares = (1.0, lag_s + first, lag_s * first + second, lag_s * second)
        out[:, axis] = sum(
            share * curve(at, nu)[:, axis] for nu, share in enumerate(shares) if share or nu == 0
        )
    return out


def within(robot: RobotDescription, name: str, commands: Array, period_s: float) -> Array:
    """The commands, held at limits that they exceed by little, such as the zero of a pressure.

    Raises:
        ContidError: they leave the limits of the axes or of their velocity; the first place is named.
    """
    axes = len(robot.axis_names)
    low, high = np.array(robot.lower), np.array(robot.upper)
    fastest = np.array(robot.rate_limits[0][:axes])
    unit = robot.quantity.unit
    inside: Array = np.maximum(low, np.minimum(high, commands))
    for what, values, least, most, margin, suffix in (
        ("is at", commands, low, high, _HELD * (high - low), unit),
        ("moves at", np.diff(inside, axis=0) / period_s, -fastest, fastest, 0.0 * fastest, f"{unit}/s"),
    ):
        bad = np.argwhere((values < least - margin) | (values > most + margin))
        if len(bad):
            row, axis = bad[0]
            shown, a, b = (
                robot.quantity.from_si(float(x)) for x in (values[row, axis], least[axis], most[axis])
            )
            raise ContidError(
                f"{name}.{robot.axis_names[axis]} {what} {shown:.3g} {suffix} at {row * period_s:.3f} s with "
                f"the lead, allowed: {a:.3g} to {b:.3g}; keep the path off that limit, let it begin and "
                "end at rest, or make it slower"
            )
    return inside
