"""The robot of a file that a calibration or an estimate is about."""

from __future__ import annotations

from typing import TypeVar

from contid.robot_file.load import LoadedFile
from contid.robot_file.robot import RobotDescription
from contid_fit.sense.calibration import CalibrationError

_Kind = TypeVar("_Kind", bound=RobotDescription)


def chosen_robot(
    loaded: LoadedFile, name: str | None, kind: type[_Kind], label: str, without: str
) -> tuple[str, _Kind]:
    """Name and description of the one robot of a kind, or of the one with that name.

    Args:
        loaded: the robot file.
        name: chooses where there are several.
        kind: class of the description.
        label: the kind in messages, such as "finger".
        without: what a message states where the file has none.

    Raises:
        CalibrationError: there is none, or no such one, or a choice is needed.
    """
    robots = {key: robot for key, robot in loaded.file.robots.items() if isinstance(robot, kind)}
    if name is None and len(robots) == 1:
        return next(iter(robots.items()))
    if name in robots:
        return name, robots[name]
    problem = "choose one with --robot" if name is None else f"no such {label} {name!r}"
    allowed = ", ".join(robots) or f"none; {without}"
    raise CalibrationError(f"{loaded.path}: {problem}; allowed: {allowed}")
