"""The robot of a file that a calibration is for."""

from __future__ import annotations

from contid.description.cosserat import Cosserat
from contid.description.load import load_robot_file
from contid.description.shipped import find_robot_file
from contid.errors import ContidError


def find_cosserat(file: str, name: str | None) -> tuple[str, Cosserat]:
    """Name and description of the pneumatic arm in a robot file; ``name`` chooses where there are several.

    Raises:
        ContidError: no such robot, none of this kind, or several and no name.
    """
    robots = load_robot_file(find_robot_file(file)).file.robots
    arms = {key: robot for key, robot in robots.items() if isinstance(robot, Cosserat)}
    if name is not None:
        if name not in arms:
            raise ContidError(f"{file}: no pneumatic arm {name!r}; there are {', '.join(arms) or 'none'}")
        return name, arms[name]
    if len(arms) != 1:
        raise ContidError(f"{file}: {len(arms)} pneumatic arms ({', '.join(arms)}); choose one with --robot")
    return next(iter(arms.items()))
