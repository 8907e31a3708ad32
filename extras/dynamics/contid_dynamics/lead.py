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
from contid_dynamics.report import pose_arm

#: Degree of the curve through the rows, whose third derivative is continuous.
_DEGREE: Final = 5
#: Share of the greatest pace of a path below which its end is at rest.
_STILL: Final = 1e-2


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
        ContidError: it has no ``dynamics``, shapes its commands itself, or has no first mode there.
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
    arm = pose_arm(robot)
    try:
        arm.settle(pose)
    except ArithmeticError as error:
        raise ContidError("the body has no equilibrium at the mean of the path; see --no-body") from error
    modes = arm.rod.modes()
    frequency_hz, ratio = float(modes.frequency_hz[0]), float(modes.ratio[0])
    if frequency_hz <= 0.0:
        raise ContidError("the body does not swing back at the mean of the path; see --no-body")
    return Answer(delay_s, lag_s, frequency_hz, ratio)


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
    longest = max(answer.delay_s)
    knots = period_s * np.arange(len(path)) if times_s is None else times_s
    rest = np.repeat(path[:1], _DEGREE, axis=0), np.repeat(path[-1:], _DEGREE, axis=0)
    end_s, beyond = float(knots[-1]), np.arange(1, _DEGREE + 1)
    before, after = (knots[1] - knots[0]) * beyond, (knots[-1] - knots[-2]) * beyond
    times = np.concatenate((-before[::-1], knots, end_s + after))
    ticks = math.ceil((end_s + longest - min(answer.delay_s)) / period_s - 1e-9) + 1
    out = np.empty((ticks, path.shape[1]))
    curve = make_interp_spline(times, np.vstack((rest[0], path, rest[1])), k=_DEGREE)
    for axis, delay_s in enumerate(answer.delay_s):
        at = np.clip(period_s * np.arange(ticks) - (longest - delay_s), 0.0, end_s)
        out[:, axis] = sum(
            share * curve(at, nu)[:, axis]
            for nu, share in enumerate(shares_of(answer, axis))
            if share or nu == 0
        )
    return out


def shares_of(answer: Answer, axis: int) -> tuple[float, float, float, float]:
    """What the path of an axis and its first three derivatives count in its lead."""
    rate, lag_s = 2.0 * math.pi * answer.frequency_hz, answer.lag_s[axis]
    first, second = 2.0 * answer.ratio / rate, rate**-2
    # (1 + T s) (1 + a s + b s^2) = 1 + (T + a) s + (T a + b) s^2 + T b s^3
    return 1.0, lag_s + first, lag_s * first + second, lag_s * second


def eased(path: Array, times_s: Array, period_s: float, ease_s: float) -> Array:
    """The path at the times of commands, begun and ended at rest.

    Within ``ease_s`` of each end that is not at rest the time of the path runs from still to its own pace,
    by a polynomial whose first three derivatives are 0 at both ends, and the path takes half of that longer.

    Args:
        path: rows ``(n, m)``; between them it is a curve of degree 5.
        times_s: of the rows, from 0 on.
        period_s: between two commands.
        ease_s: how long it sets out, and how long it stops.

    Raises:
        ContidError: the path has too few rows, or is too short.
    """
    from scipy.interpolate import make_interp_spline

    if len(path) <= _DEGREE:
        raise ContidError(f"a path of {len(path)} rows has no lead; at least {_DEGREE + 1} are needed")
    curve, end_s = make_interp_spline(times_s, path, k=_DEGREE), float(times_s[-1])
    pace = np.linalg.norm(np.diff(path, axis=0), axis=1) / np.diff(times_s)
    still = _STILL * float(pace.max())
    sets_out, stops = (0.0 if pace[at] <= still else ease_s for at in (0, -1))
    if sets_out + stops > 2.0 * end_s:
        raise ContidError(
            f"the path of {end_s:.3g} s does not begin and end at rest, and setting out and stopping take "
            f"{ease_s:.3g} s each; make it longer, or let it begin and end at rest"
        )
    lasts_s = end_s + 0.5 * (sets_out + stops)
    at_s = np.minimum(period_s * np.arange(math.ceil(lasts_s / period_s - 1e-9) + 1), lasts_s)
    return np.asarray(curve(np.minimum(end_s, _path_time(at_s, lasts_s, sets_out, stops))))


def _path_time(at_s: Array, lasts_s: float, sets_out: float, stops: float) -> Array:
    out = at_s - 0.5 * sets_out
    if sets_out:
        out = np.where(at_s < sets_out, sets_out * _ramp(np.minimum(at_s / sets_out, 1.0)), out)
    if stops:
        left = lasts_s - at_s
        end_s = lasts_s - 0.5 * (sets_out + stops)
        out = np.where(left < stops, end_s - stops * _ramp(np.clip(left / stops, 0.0, 1.0)), out)
    return np.asarray(out)


def _ramp(x: Array) -> Array:
    """Integral of the polynomial of degree 7 from 0 to 1."""
    return np.asarray(x**5 * (7.0 - 14.0 * x + 10.0 * x**2 - 2.5 * x**3))


def answered(commands: Array, period_s: float, answer: Answer) -> Array:
    """What the axes of the body do after commands, without the least dead time of the answer.

    Args:
        commands: ``(ticks, axes)``; the robot rests at the first.
        period_s: between two.
        answer: of the robot.
    """
    from scipy.signal import lsim

    rate = 2.0 * math.pi * answer.frequency_hz
    mode = [rate**-2, 2.0 * answer.ratio / rate, 1.0] if math.isfinite(rate) else [1.0]
    times = period_s * np.arange(len(commands))
    out = np.empty_like(commands)
    for axis, (delay_s, lag_s) in enumerate(zip(answer.delay_s, answer.lag_s, strict=True)):
        late = np.interp(times - delay_s + min(answer.delay_s), times, commands[:, axis])
        parts = np.trim_zeros(np.polymul([lag_s, 1.0], mode), "f")
        out[:, axis] = late[0] + (
            lsim(([1.0], parts), late - late[0], times)[1] if len(parts) > 1 else late - late[0]
        )
    return out


def check_velocities(robot: RobotDescription, name: str, commands: Array, period_s: float) -> None:
    """Whether commands keep the velocities of the axes.

    Raises:
        ContidError: they do not; the first place is named.
    """
    fastest = np.array(robot.rate_limits[0][: len(robot.axis_names)])
    moves = np.diff(commands, axis=0) / period_s
    bad = np.argwhere(np.abs(moves) > (1.0 + 1e-6) * fastest)
    if len(bad):
        row, axis = bad[0]
        shown, most = (robot.quantity.from_si(float(x)) for x in (moves[row, axis], fastest[axis]))
        raise ContidError(
            f"{name}.{robot.axis_names[axis]} moves at {shown:.3g} {robot.quantity.unit}/s at "
            f"{row * period_s:.3f} s with the lead, allowed: {most:.3g}; make the path slower"
        )
