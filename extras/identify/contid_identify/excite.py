"""Motions that show how a robot moves: steps, sums of sines, a chirp and ring-downs, within its limits.

Axes are the robot's own; a tendon robot bends its sections instead, because its tendons pull against each
other. Every part begins and ends at the same pose. It is made smaller, or slower, until the check that
`contid check` makes of a trajectory accepts it: reach, limits, speed, tension and clearance.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.control.engine.wiring import build_preflight
from contid.control.tick.preflight.rows import Preflight, TooFastError, Unreachable
from contid.errors import BadInputError, ContidError
from contid.kinematics.array import Array
from contid.robot_file.load import LoadedFile
from contid.robot_file.robot import RobotDescription
from contid.robot_file.tendon.robot import TendonRobot
from contid.trajectory.columns import column_groups
from contid.trajectory.read import read_trajectory

#: Rows per second.
ROWS_HZ: Final = 50.0
#: Share of the travel of an axis that is used at most, and greatest bend of a section [rad].
_SHARE: Final = 0.6
_BEND_RAD: Final = math.radians(45.0)
#: Smaller or slower by this much per try, and the tries.
_STEP: Final = 0.75
_TRIES: Final = 16
#: Rest at both ends of a part, and behind each move of a ring-down [s].
_REST_S: Final = 0.5
_RINGS_S: Final = 3.0
#: Lines of the sum of sines.
_LINES: Final = 24


@dataclass(frozen=True, slots=True)
class ExcitedPart:
    """One accepted part.

    Attributes:
        name: kind of motion.
        duration_s: of it.
        share: of the amplitude that was tried first.
        slowed: how much longer than tried first.
    """

    name: str
    duration_s: float
    share: float
    slowed: float


@dataclass(frozen=True, eq=False)
class ExcitingTrajectory:
    """An accepted trajectory.

    Attributes:
        text: CSV.
        parts: in order.
        columns: that move.
    """

    text: str
    parts: tuple[ExcitedPart, ...]
    columns: tuple[str, ...]

    @property
    def duration_s(self) -> float:
        """Of the whole."""
        return sum(part.duration_s for part in self.parts)


@dataclass(frozen=True, eq=False)
class _Coordinates:
    """What is moved: centre and amplitude of each coordinate, and the columns that they become."""

    columns: tuple[str, ...]
    centre: Array
    amplitude: Array
    to_columns: Callable[[Array], Array]


#: From an amplitude of 1 and a slowness of 1 to times and rows of coordinates between -1 and 1.
_Shape = Callable[[float], Array]


def exciting(
    loaded: LoadedFile, name: str, duration_s: float, kinds: Sequence[str], upper_hz: float, seed: int
) -> ExcitingTrajectory:
    """A trajectory that excites one robot of a file.

    Args:
        loaded: the file.
        name: of the robot.
        duration_s: about how long.
        kinds: parts in order, of `KINDS`.
        upper_hz: highest frequency.
        seed: of the random phases and orders.

    Raises:
        ContidError: no part of it is accepted, however small.
    """
    robot = loaded.driven[name]
    coordinates = _coordinates(robot, "" if len(loaded.driven) == 1 else f"{name}.")
    preflight = build_preflight(loaded, loaded.file.rate_hz, Unreachable.REFUSE)
    assert preflight is not None, "refusing always checks"
    rng = np.random.default_rng(seed)
    count = len(coordinates.centre)
    rows, parts = [], []
    for kind in kinds:
        part_s = duration_s / len(kinds)
        shape = KINDS[kind](count, part_s, upper_hz, rng)
        found, part = _accepted(kind, shape, coordinates, preflight, loaded)
        rows.append(found)
        parts.append(part)
    text = _csv(np.vstack(rows), coordinates)
    _check(text, preflight, loaded)
    return ExcitingTrajectory(text, tuple(parts), coordinates.columns)


def _accepted(
    kind: str, shape: _Shape, coordinates: _Coordinates, preflight: Preflight, loaded: LoadedFile
) -> tuple[Array, ExcitedPart]:
    share, slowed = 1.0, 1.0
    last: BadInputError | None = None
    for _ in range(_TRIES):
        rows = share * shape(slowed)
        try:
            _check(_csv(rows, coordinates), preflight, loaded)
        except TooFastError as error:
            last = error
            # A sum of sines keeps its frequencies: it becomes smaller.
            if kind in ("sines", "chirp"):
                share *= _STEP
            else:
                slowed /= _STEP
            continue
        except BadInputError as error:
            last = error
            share *= _STEP
            continue
        return rows, ExcitedPart(kind, len(rows) / ROWS_HZ, share, slowed)
    raise ContidError(f"no {kind} of {loaded.file.name} is accepted, however small: {last}")


def _check(text: str, preflight: Preflight, loaded: LoadedFile) -> None:
    preflight.trajectory(read_trajectory(io.StringIO(text), "excitation", loaded.driven), "excitation")


def _csv(rows: Array, coordinates: _Coordinates) -> str:
    values = coordinates.to_columns(coordinates.centre + coordinates.amplitude * rows)
    lines = ["t_s," + ",".join(coordinates.columns)]
    for k, row in enumerate(values):
        lines.append(f"{k / ROWS_HZ:.2f}," + ",".join(f"{value:.6g}" for value in row))
    return "\n".join(lines) + "\n"


def _coordinates(robot: RobotDescription, prefix: str) -> _Coordinates:
    groups = column_groups(prefix, robot)
    if isinstance(robot, TendonRobot):
        return _bends([each for each in groups["arcs"] if each.endswith(("bend_deg", "azimuth_deg"))])
    count = len(robot.axis_names)
    low, high, rest = (np.array(each[:count]) for each in (robot.lower, robot.upper, robot.rest))
    half = 0.5 * _SHARE * (high - low)
    centre = np.clip(rest, low + half, high - half)
    unit = robot.quantity.to_si(1.0)
    return _Coordinates(tuple(groups["actuation"]), centre / unit, half / unit, lambda rows: rows)


def _bends(columns: Sequence[str]) -> _Coordinates:
    """Components of the bends of sections: rows ``(u1, v1, u2, v2, ..)`` [rad]."""

    def to_columns(rows: Array) -> Array:
        out = np.empty_like(rows)
        u, v = rows[:, 0::2], rows[:, 1::2]
        out[:, 0::2] = np.degrees(np.hypot(u, v))
        out[:, 1::2] = np.degrees(np.arctan2(v, u))
        return out

    count = len(columns)
    return _Coordinates(tuple(columns), np.zeros(count), np.full(count, _BEND_RAD), to_columns)


def _smooth(share: Array) -> Array:
    """From 0 to 1 with the least jerk (Flash and Hogan 1985)."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s * s))


def _through(times_s: Sequence[float], poses: Sequence[Array], moves_s: float) -> Array:
    """Rows that stand at poses and go to the next one within ``moves_s`` from each of the times."""
    at_s = np.arange(math.ceil((times_s[-1] + moves_s + _REST_S) * ROWS_HZ)) / ROWS_HZ
    rows = np.zeros((len(at_s), len(poses[0])))
    before = np.zeros(len(poses[0]))
    for start_s, pose in zip(times_s, poses, strict=True):
        rows += _smooth((at_s - start_s) / moves_s)[:, None] * (pose - before)
        before = pose
    return rows


def _steps(count: int, part_s: float, upper_hz: float, rng: np.random.Generator) -> _Shape:
    """Every coordinate alone to one side and back, in random order, then several together at random."""
    order = rng.permutation(count)
    each_s = 0.5 / upper_hz
    hold_s = max(part_s / (3.0 * count), 0.4)

    def shape(slowed: float) -> Array:
        times, poses, at_s = [], [], _REST_S
        draws = np.random.default_rng(int(order @ np.arange(1, count + 1)))
        for k in order:
            for size in (draws.choice([-1.0, 1.0]), 0.0):
                poses.append(size * np.eye(count)[k])
                times.append(at_s)
                at_s += each_s * slowed + hold_s * draws.uniform(0.6, 1.4)
        for _ in range(count):
            poses.append(draws.uniform(-0.7, 0.7, count))
            times.append(at_s)
            at_s += each_s * slowed + hold_s * draws.uniform(0.6, 1.4)
        return _through([*times, at_s], [*poses, np.zeros(count)], each_s * slowed)

    return shape


def _sines(count: int, part_s: float, upper_hz: float, rng: np.random.Generator) -> _Shape:
    """Sums of sines; each coordinate has lines of its own, so that their answers can be separated."""
    at_s = np.arange(math.ceil(part_s * ROWS_HZ)) / ROWS_HZ
    lines = np.geomspace(max(2.0 / part_s, 0.05 * upper_hz), upper_hz, max(_LINES, 3 * count))
    phases = rng.uniform(0.0, 2.0 * math.pi, len(lines))
    # Smaller at higher frequencies: the speed is about the same in each.
    waves = np.sin(2.0 * math.pi * lines * at_s[:, None] + phases) / lines
    sums = np.column_stack([waves[:, k::count].sum(axis=1) for k in range(count)])
    return lambda slowed: sums / np.abs(sums).max(axis=0) * _ends(at_s)[:, None]


def _chirp(count: int, part_s: float, upper_hz: float, rng: np.random.Generator) -> _Shape:
    """One coordinate after the other from slow to fast, at about the same speed."""
    each_s = part_s / count
    at_s = np.arange(math.ceil(each_s * ROWS_HZ)) / ROWS_HZ
    low_hz = max(1.0 / each_s, 0.1 * upper_hz)
    rate = math.log(upper_hz / low_hz) / each_s if upper_hz > low_hz else 1e-9
    phase = 2.0 * math.pi * low_hz * np.expm1(rate * at_s) / rate
    wave = np.sin(phase) * np.exp(-rate * at_s) * _ends(at_s)
    rows = np.zeros((count * len(at_s), count))
    for place, k in enumerate(rng.permutation(count)):
        rows[place * len(at_s) : (place + 1) * len(at_s), k] = wave
    return lambda slowed: rows


def _ring_downs(count: int, part_s: float, upper_hz: float, rng: np.random.Generator) -> _Shape:
    """Away, then back as fast as is allowed, and rest until the swing has died out."""
    moves = max(int(part_s / (2.0 * _RINGS_S)), 1)
    order = rng.permutation(count)[: max(moves, 1)]

    def shape(slowed: float) -> Array:
        move_s = 0.1 * slowed
        times, poses, at_s = [], [], _REST_S
        for k in np.resize(order, moves):
            for size in (1.0, 0.0):
                poses.append(size * np.eye(count)[k])
                times.append(at_s)
                at_s += move_s + _RINGS_S
        return _through([*times, at_s], [*poses, np.zeros(count)], move_s)

    return shape


def _ends(at_s: Array) -> Array:
    """1 with smooth ends."""
    ramp_s = min(1.0, 0.2 * float(at_s[-1]))
    return np.asarray(_smooth(at_s / ramp_s) * _smooth((at_s[-1] - at_s) / ramp_s))


#: Kind -> its shape for a count of coordinates, a duration, the highest frequency, and random numbers.
KINDS: Final[dict[str, Callable[[int, float, float, np.random.Generator], _Shape]]] = {
    "steps": _steps,
    "sines": _sines,
    "chirp": _chirp,
    "ring-downs": _ring_downs,
}
