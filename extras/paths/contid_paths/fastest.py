"""The fastest timing of a path within velocity, acceleration and jerk of every axis.

1. The path is solved for the axes of all its robots, and measured by the time that each step takes at the
   greatest velocity. Where nothing moves it has no length: dwells are left out.
2. TOPP-RA gives the time-optimal speed along it under velocity and acceleration (H. Pham, Q.-C. Pham, "A New
   Approach to Time-Optimal Path Parameterization Based on Reachability Analysis", IEEE Trans. Robotics 34(3),
   2018; package toppra).
3. Its acceleration jumps. A moving average over time spreads every jump and so bounds the jerk.
4. Differences of the axes at the rate of the tick, over all ticks, decide: where one exceeds its limit, time
   is stretched around it, until velocity, acceleration and jerk hold. Of several widths the fastest is kept.

So all three limits hold at every tick; the timing is optimal for the first two limits, near it for all three.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final, TextIO

import numpy as np

from contid.control.daemon.check_trajectory import check_rows, read_both
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.preflight.rows import TooFastError
from contid.errors import ContidError, missing_extra
from contid.kinematics.array import Array
from contid.robot_file.load import LoadedFile
from contid.trajectory.rows import MAX_ROWS
from contid.trajectory.timed import Trajectory

#: Points at which a path is solved, at least and at most.
MIN_POINTS: Final = 500
MAX_POINTS: Final = 20_000
#: Widths of the moving average, as multiples of the time in which jerk reaches the greatest acceleration.
WIDTHS: Final = (0.25, 0.35, 0.5, 0.7, 1.0)
#: Rounds of slowing down where a limit is exceeded, at most.
ROUNDS: Final = 60
#: Steps of so many times what the greatest velocity allows, where the smooth path needs no more than that.
JUMP: Final = 10.0
#: Steps per tick of the profile.
PARTS: Final = 10
#: Room for rounding, and for the model's answer at a tick that differs from the one interpolated here.
MARGIN: Final = 1.002
#: A path shorter than this, in seconds at the greatest velocity, does not move.
_NO_MOTION_S: Final = 1e-9


@dataclass(frozen=True, slots=True)
class FastestPath:
    """A retimed trajectory.

    Attributes:
        columns: as in the file.
        rows: in the units of the columns, one per tick; the time begins at 0.
        duration_s: of it.
        binding: the limit that decides: ``velocity``, ``acceleration`` or ``jerk``.
    """

    columns: tuple[str, ...]
    rows: Array
    duration_s: float
    binding: str


def fastest_trajectory(robot_file: str, trajectory: str, text: TextIO | None = None) -> FastestPath:
    """The fastest timing of a trajectory (``-``: stdin) for a robot file, at the rate of the file.

    Args:
        robot_file: path, or name of a shipped file.
        trajectory: path of a file, or name of ``text``.
        text: the trajectory; None to read the file.

    Raises:
        ContidError: the robot file or the trajectory is wrong, or a robot cannot reach it.
    """
    loaded, source = read_both(robot_file, trajectory, text)
    with suppress(TooFastError):
        check_rows(loaded, source, trajectory)
    return fastest(loaded, source, loaded.file.rate_hz)


def fastest(loaded: LoadedFile, trajectory: Trajectory, rate_hz: float) -> FastestPath:
    """Retime a trajectory that is within reach.

    Args:
        loaded: the robot file.
        trajectory: its times give the order of the points only.
        rate_hz: of the tick; rows come at this rate.

    Raises:
        ContidError: nothing moves, it is too long, or toppra is not installed.
    """
    first = trajectory.targets_of_row(0)
    configs = [config for config in build_robot_configs(loaded, rate_hz) if config.name in first]
    times = _points(trajectory)
    axes = _solved(configs, trajectory, times)
    most = [
        np.array([value for config in configs for value in getattr(config, name)])
        for name in ("velocity", "acceleration", "jerk")
    ]
    steps_s = np.max(np.abs(np.diff(axes, axis=0)) / most[0], axis=1)
    kept = np.concatenate([[True], steps_s > 1e-12])
    along = np.concatenate([[0.0], np.cumsum(steps_s)])[kept]
    if along[-1] < _NO_MOTION_S:
        raise ContidError("nothing to retime: no axis moves along this trajectory")
    _check_count(along[-1] * rate_hz, rate_hz)  # before the work: it takes at least as long

    def exact(at: Array) -> Array:
        return _solved(configs, trajectory, np.interp(at, along, times[kept]))

    try:
        best = _parametrised(along, axes[kept], most, 1.0 / rate_hz, exact)
    except _NoTimingError as error:
        time_s = float(np.interp(error.along, along, times[kept]))
        raise ContidError(f"no timing found: near t_s = {time_s:.3f} {error}; move the path") from None
    _check_count(len(best.along), rate_hz)
    at = np.interp(best.along, along, times[kept])
    rows = np.array([_row(trajectory, time_s) for time_s in at.tolist()])
    assert trajectory.layout.time is not None
    rows[:, trajectory.layout.time] = np.arange(len(rows)) / rate_hz
    return FastestPath(trajectory.columns, rows, (len(rows) - 1) / rate_hz, best.binding)


def _check_count(count: float, rate_hz: float) -> None:
    """Refuse more rows than a trajectory may have.

    Raises:
        ContidError: with their number.
    """
    if count > MAX_ROWS:
        raise ContidError(
            f"at {rate_hz:g} Hz the fastest timing has {count:.3g} rows; allowed are {MAX_ROWS}: cut the path"
        )


def _points(trajectory: Trajectory) -> Array:
    """Times in the trajectory at which its path is solved: its rows, and points between them."""
    spans = max(len(trajectory) - 1, 1)
    parts = max(1, math.ceil(MIN_POINTS / spans))
    if spans * parts > MAX_POINTS:
        raise ContidError(f"{len(trajectory)} rows are too many to retime; at most {MAX_POINTS}")
    knots = np.array([trajectory.time_of_row(k) for k in range(len(trajectory))])
    times: Array = np.interp(np.arange(spans * parts + 1) / parts, np.arange(len(knots)), knots)
    return times


def _solved(configs: Sequence[RobotConfig], trajectory: Trajectory, times: Array) -> Array:
    """The axes of all robots at times of the trajectory, shape ``(n, axes)`` [m or Pa]."""
    seeds = {config.name: config.rest for config in configs}
    out = []
    for time_s in times.tolist():
        targets = trajectory.targets_at(time_s)
        for config in configs:
            in_base = config.frame.target_in_base(targets[config.name])
            seeds[config.name] = config.model.inverse(in_base, seeds[config.name]).actuation
        out.append([value for config in configs for value in seeds[config.name]])
    return np.array(out)


@dataclass(frozen=True)
class _Timing:
    """Places along the path, one per tick, and the limit that decides."""

    along: Array
    binding: str


class _NoTimingError(Exception):
    """No timing passes a place along the path, and what the axes do there."""

    def __init__(self, along: float, what: str) -> None:
        super().__init__(what)
        self.along = along


def _parametrised(
    along: Array, axes: Array, most: Sequence[Array], period_s: float, exact: Callable[[Array], Array]
) -> _Timing:
    """Times of the path.

    Args:
        along: places along the path.
        axes: there.
        most: greatest velocity, acceleration and jerk of each axis.
        period_s: of the tick.
        exact: the axes at other places, solved and not interpolated; they have the last word.

    Raises:
        _NoTimingError: none was found.
    """
    path, clock_s, place, speed = _time_optimal(along, axes, most)
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    optimal = CubicHermiteSpline(clock_s, place, speed)
    rise_s = float(np.max(most[1] / most[2]))
    step_s = period_s / PARTS
    found: list[tuple[int, _Timing]] = []
    for width in WIDTHS:
        smooth = _averaged(optimal, float(clock_s[-1]), float(along[-1]), width * rise_s, step_s)
        clock = np.arange(len(smooth)) * step_s
        spread = max(3, round(width * rise_s / period_s))
        for _ in range(ROUNDS):
            ticks = math.ceil(clock[-1] / period_s)
            clock *= ticks * period_s / clock[-1]
            times = np.arange(ticks + 1) * period_s
            at = np.clip(CubicSpline(clock, smooth)(times), 0.0, along[-1])
            needs = _needs(np.asarray(path(at)) * most[0], most, period_s)
            if max(np.max(each) for each in needs.values()) <= 1.0:
                needs = _needs(exact(at), most, period_s)
                if np.max(needs["velocity"]) > JUMP:
                    jump = float(at[int(np.argmax(needs["velocity"]))])
                    raise _NoTimingError(jump, "the axes jump to another pose with the same tip")
            worst = max(needs, key=lambda name: float(np.max(needs[name])))
            if np.max(needs[worst]) <= 1.0:
                found.append((ticks, _Timing(at, worst)))
                break
            slower = _spread(np.stack(list(needs.values())).max(axis=0), spread)
            pace = np.interp(0.5 * (clock[1:] + clock[:-1]), times, slower)
            clock = np.concatenate([[0.0], np.cumsum(np.diff(clock) * pace)])
    if not found:
        corner = (
            f"the {worst} of an axis exceeds its limit however slowly it passes, as where it has a corner"
        )
        raise _NoTimingError(float(at[int(np.argmax(needs[worst]))]), corner)
    return min(found, key=lambda each: each[0])[1]


def _spread(needs: Array, ticks: int) -> Array:
    """How many times slower each tick becomes: what it needs, given to its neighbours with a smooth edge."""
    needs = np.maximum(needs, 1.0)
    wide = np.pad(np.where(needs > 1.0, needs * MARGIN, 1.0), 3 * ticks, constant_values=1.0)
    windows = np.lib.stride_tricks.sliding_window_view(wide, 4 * ticks + 1).max(axis=1)
    average = np.full(ticks + 1, 1.0 / (ticks + 1))
    smooth: Array = np.convolve(np.convolve(windows, average, mode="valid"), average, mode="same")
    smooth = smooth[(len(smooth) - len(needs)) // 2 :][: len(needs)]
    return np.maximum(smooth, 1.0)


def _averaged(optimal: Any, duration_s: float, end: float, width_s: float, step_s: float) -> Array:
    """The place over time, averaged over ``width_s`` twice; it begins and ends at rest."""
    count = max(1, round(width_s / step_s))
    times = np.arange(math.ceil(duration_s / step_s) + 1) * step_s
    place = np.clip(optimal(np.minimum(times, duration_s)), 0.0, end)
    window = np.full(count, 1.0 / count)
    for _ in range(2):
        padded = np.concatenate([np.zeros(count), place, np.full(count, end)])
        place = np.convolve(padded, window, mode="valid")
    smooth: Array = np.maximum.accumulate(np.clip(place, 0.0, end))
    return smooth


def _needs(axes: Array, most: Sequence[Array], period_s: float) -> dict[str, Array]:
    """By limit and tick, how many times slower it has to be; from standstill to standstill."""
    still = np.concatenate([axes[:1].repeat(3, axis=0), axes, axes[-1:].repeat(3, axis=0)])
    out = {}
    for order, name in enumerate(("velocity", "acceleration", "jerk"), 1):
        most_change = most[order - 1] * period_s**order
        share = np.max(np.abs(np.diff(still, order, axis=0)) / most_change, axis=1) ** (1.0 / order)
        # A difference spans `order` ticks; each of them counts. One entry per row of `axes`.
        spans = np.pad(share, (order, order))
        windows = np.lib.stride_tricks.sliding_window_view(spans, order + 1).max(axis=1)
        out[name] = windows[3 : 3 + len(axes)]
        out[name][0] = max(out[name][0], np.max(windows[:3]))
        out[name][-1] = max(out[name][-1], np.max(windows[3 + len(axes) :]))
    return out


def _time_optimal(along: Array, axes: Array, most: Sequence[Array]) -> tuple[Any, Array, Array, Array]:
    """The path as a spline of axes by their greatest velocities, and times, places and speeds by TOPP-RA.

    The solver compares with absolute numbers: pressures in Pa would be too large for them.
    """
    try:
        import toppra
        import toppra.algorithm
        import toppra.constraint
    except ModuleNotFoundError as error:
        raise missing_extra(error, "the fastest timing") or error from None
    toppra.setup_logging("ERROR")
    path = toppra.SplineInterpolator(along, axes / most[0])
    limits = [np.stack([-each, each], axis=1) / most[0][:, None] for each in most[:2]]
    constraints = [
        toppra.constraint.JointVelocityConstraint(limits[0]),
        toppra.constraint.JointAccelerationConstraint(limits[1]),
    ]
    places = np.linspace(0.0, along[-1], max(1001, len(along)))
    solver = toppra.algorithm.TOPPRA(constraints, path, gridpoints=places, solver_wrapper="seidel")
    _, speed, _ = solver.compute_parameterization(0.0, 0.0)
    if speed is None or not np.isfinite(speed).all():
        raise ContidError("no timing found within velocity and acceleration; give the path more rows")
    steps_s = 2.0 * np.diff(places) / np.maximum(speed[1:] + speed[:-1], 1e-12)
    clock_s = np.concatenate([[0.0], np.cumsum(steps_s)])
    return path, clock_s, places, np.asarray(speed)


def _row(trajectory: Trajectory, time_s: float) -> list[float]:
    """The row of a time, in the units of the columns."""
    layout, values = trajectory.layout, trajectory.values_at(time_s)
    for columns in layout.robots:
        for section in columns.arcs:
            section.restore(values)
    return [
        value * divisor / factor
        for value, factor, divisor in zip(values, layout.factors, layout.divisors, strict=True)
    ]
