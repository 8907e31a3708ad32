"""Which robot of a file a calibration is about, and writing what it found into that file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

from contid.errors import ContidError
from contid.robot_file.edit import Change, set_values
from contid.robot_file.load import load_named, load_robot_file, parse_robot_file
from contid.robot_file.robot import RobotDescription

_Kind = TypeVar("_Kind", bound=RobotDescription)


def find_robot(file: str, name: str | None, kind: type[_Kind], label: str) -> tuple[str, _Kind]:
    """Name and description of the one robot of a kind in a robot file.

    Args:
        file: path, or name of a shipped robot file.
        name: chooses where there are several.
        kind: class of the description.
        label: the kind in messages, such as "pneumatic arm".

    Raises:
        ContidError: no such robot, none of this kind, or several and no name.
    """
    robots = load_named(file).file.robots
    found = {key: robot for key, robot in robots.items() if isinstance(robot, kind)}
    if name is not None:
        if name not in found:
            raise ContidError(f"{file}: no {label} {name!r}; the file has {', '.join(found) or 'none'}")
        return name, found[name]
    if len(found) != 1:
        names = ", ".join(found) or "none"
        raise ContidError(f"{file}: {len(found)} robots of kind {label} ({names}); choose with --robot")
    return next(iter(found.items()))


def write_back(path: Path, robot: str, changes: Sequence[Change], measured: Sequence[str] = ()) -> None:
    """Write calibrated values below ``robots.ROBOT`` and remove them from its placeholders.

    The new text is checked as a robot file before it replaces the old one in one step.

    Args:
        path: path of the robot file.
        robot: its name.
        changes: keys are relative to the robot, such as ``correction.b``.
        measured: further keys to remove from the placeholders, such as a list whose parts are all written.

    Raises:
        BadInputError: the result would not load; the file is unchanged.
        ContidError: a key's mapping is not in the file, or it cannot be written.
    """
    loaded = load_robot_file(path)
    written = [*(change.key for change in changes), *measured]
    marked = loaded.file.robots[robot].placeholder
    rest = [key for key in marked if key not in written]
    front = f"robots.{robot}."
    edits = [Change(front + change.key, change.value, change.comment) for change in changes]
    if len(rest) < len(marked):
        edits.append(Change(front + "placeholder", rest))
    set_values(path, edits, lambda text: parse_robot_file(text, str(path)))
