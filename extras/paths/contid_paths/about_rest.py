"""A path of a shape that robots can follow about their rest pose: its place, size and period.

The shape is as large as can be: half the distance from the base to the tip at rest, else half of that, and so
on. Its centre is on the line of the tip's direction at rest, as near to the tip as can be: straight arms rest
at the edge of their reach, so a shape about the tip itself may be out of it. Where a shape through the axis
of an arm is refused, because answers are not continuous there, it is moved to the side, off the axis. Of what
is reached, the check of a run decides; a period that is too short becomes longer.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Final

from contid.control.engine.wiring import build_preflight, build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.preflight.rows import Preflight, TooFastError, Unreachable
from contid.errors import BadInputError, ContidError
from contid.robot_file.load import LoadedFile, load_named
from contid.targets import Target, Vec3, unit_vector, vec3
from contid.trajectory.read import read_trajectory
from contid.units import MM_PER_M, m_to_mm
from contid_paths.shapes import ShapePath
from contid_paths.table import PathRobot, write_path

#: Sizes that are tried, each half of the one before.
_SIZES: Final = 7
#: Centres that are tried to either side of the tip, this share of the size apart.
_CENTRES: Final = 20
_APART: Final = 0.125
#: How far a shape is moved to the side, by its size.
_BESIDE: Final = 0.75
#: Centres within reach that the check of a run gets for each size and side.
_CHECKED: Final = 3
#: Points, spread evenly over all laps, that are solved before the check of a run.
_POINTS: Final = 24
#: Decimals of chosen lengths [mm] and periods [s]; attempts to find a period.
_DECIMALS: Final = 1
_ATTEMPTS: Final = 4
#: A path becomes slower by this factor more than the least one that the check states.
_MARGIN: Final = 1.01


@dataclass(frozen=True, slots=True)
class PathAboutRest:
    """A path and the robots that follow it, each about its own centre.

    Attributes:
        path: the shape about the origin.
        robots: with their centres.
    """

    path: ShapePath
    robots: Sequence[PathRobot]

    def __str__(self) -> str:
        """What was chosen."""
        at = [", ".join(f"{value:g}" for value in each.origin_mm[: each.dimension]) for each in self.robots]
        names = [each.prefix.rstrip(".") for each in self.robots]
        places = " and ".join(
            f"{where} ({name})" if name else where for where, name in zip(at, names, strict=True)
        )
        return (
            f"{self.path.shape} of {self.path.size_mm:g} mm about {places} mm, {self.path.period_s:g} s a lap"
        )


def path_about_rest(robot_file: str, robots: Sequence[PathRobot], shape: ShapePath) -> PathAboutRest:
    """Choose place, size and period.

    Args:
        robot_file: path, or name of a shipped file.
        robots: of that file.
        shape: its place and size are replaced, its period when it is too short.

    Raises:
        ContidError: the robot file is wrong, or no such path was found.
    """
    loaded = load_named(robot_file)
    configs = {config.name: config for config in build_robot_configs(loaded, loaded.file.rate_hz)}
    followers = [(each, configs[each.prefix.rstrip(".") or next(iter(configs))]) for each in robots]
    largest_mm = min(_reach_mm(config) for _, config in followers) / 2.0
    for halvings in range(_SIZES):
        size_mm = round(largest_mm / 2.0**halvings, _DECIMALS)
        path = replace(shape, center_mm=(0.0, 0.0), height_mm=0.0, size_mm=size_mm)
        for beside in (0.0, _BESIDE) if all(each.dimension == 3 for each in robots) else (0.0,):
            centres = zip(*(_centres(config, path, beside) for _, config in followers), strict=False)
            for placed in islice(centres, _CHECKED):
                pairs = zip(robots, placed, strict=True)
                found = PathAboutRest(path, [replace(each, origin_mm=centre) for each, centre in pairs])
                if (timed := _timed(loaded, found)) is not None:
                    return timed
    raise ContidError(
        f"{robot_file}: no {shape.shape} about the rest pose is within reach; give --size and --height"
    )


def _reach_mm(config: RobotConfig) -> float:
    """Distance from the base to the tip at rest [mm]."""
    return m_to_mm(math.hypot(*config.model.forward(config.rest).tip_m))


def _centres(config: RobotConfig, path: ShapePath, beside: float) -> Iterator[Vec3]:
    """Centres in the world [mm] about which points of the shape are within reach, the nearest first.

    ``beside`` is how far they are from the tip's line, across it and the shape's first axis, by the size.
    """
    pose = config.model.forward(config.rest)
    tip_m = config.frame.point_in_world(pose.tip_m)
    along = config.frame.vector_in_world(pose.direction)
    # The cross product of the tip's direction and x, the shape's first axis; y where these are parallel.
    aside = unit_vector((0.0, along[2], -along[1])) or (0.0, 1.0, 0.0)
    aside_mm = beside * path.size_mm
    # The tip itself, then one step back, one step on, two steps back, and so on.
    steps = [0, *(side * count for count in range(1, _CENTRES + 1) for side in (-1, 1))]
    for step in steps:
        away_mm = _APART * path.size_mm * step
        axes = zip(tip_m, along, aside, strict=True)
        lengths = (m_to_mm(p) + away_mm * d + aside_mm * s for p, d, s in axes)
        centre = vec3(round(value, _DECIMALS) + 0.0 for value in lengths)  # 0.0 also for -0.0
        if _reached(config, path, centre):
            yield centre


def _reached(config: RobotConfig, path: ShapePath, centre_mm: Vec3) -> bool:
    seed = config.rest
    for k in range(_POINTS + 1):
        time_s = path.laps * path.period_s * k / _POINTS
        tip = vec3((a + b) / MM_PER_M for a, b in zip(path.point_mm(time_s), centre_mm, strict=True))
        target = Target(tip, None if path.lean_deg is None else path.direction(time_s))
        found = config.model.inverse(config.frame.target_in_base(target), seed)
        if not found.converged:
            return False
        seed = found.actuation
    return True


def _timed(loaded: LoadedFile, found: PathAboutRest) -> PathAboutRest | None:
    """The same path, as much slower as it has to be; None where the check refuses it at any speed."""
    preflight = build_preflight(loaded, loaded.file.rate_hz, Unreachable.REFUSE)
    assert preflight is not None, "refusing always checks"
    for _ in range(_ATTEMPTS):
        slowdown = _slowdown(preflight, loaded, found)
        if math.isinf(slowdown):
            return None
        if slowdown == 1.0:
            return found
        period_s = math.ceil(slowdown * found.path.period_s * 10.0**_DECIMALS) / 10.0**_DECIMALS
        found = replace(found, path=replace(found.path, period_s=period_s))
    return None


def _slowdown(preflight: Preflight, loaded: LoadedFile, found: PathAboutRest) -> float:
    """How many times slower a path has to be: 1 for one that is followed, infinite where no speed helps."""
    text = io.StringIO()
    write_path(text, found.path, found.robots)
    text.seek(0)
    trajectory = read_trajectory(text, "path", loaded.driven)
    try:
        # Ends at the first place that is refused; it raises when that is refused at any speed.
        preflight.follows(trajectory, "path")
        preflight.trajectory(trajectory, "path")
    except TooFastError as error:
        return _MARGIN * error.slowdown
    except BadInputError:
        return math.inf
    return 1.0
