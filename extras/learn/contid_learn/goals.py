"""The text of ``--goal``: where the tips are to be."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_learn.views import RobotView


def parse_goal(text: str) -> dict[str, float]:
    """Columns and values of ``x_mm=30,y_mm=85``.

    Raises:
        ContidError: with the part that is wrong.
    """
    found: dict[str, float] = {}
    for part in text.split(","):
        column, equals, number = part.strip().partition("=")
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if not equals or not math.isfinite(value):
            raise ContidError(f"--goal: {part.strip()!r} is not COLUMN=NUMBER, such as x_mm=30")
        if column in found:
            raise ContidError(f"--goal: {column} is given twice")
        found[column] = value
    return found


def goals_of(views: Sequence[RobotView], columns: Mapping[str, float]) -> dict[str, Array]:
    """The tips by robot.

    Raises:
        ContidError: a column is missing, or there is none of that name.
    """
    left = dict(columns)
    goals = {}
    for view in views:
        prefix = f"{view.name}." if len(views) > 1 else ""
        names = [f"{prefix}{letter}_mm" for letter in "xyz"[: view.dimension]]
        missing = [name for name in names if name not in left]
        if missing:
            raise ContidError(f"--goal: no {', '.join(missing)}; needed: {', '.join(names)}")
        goals[view.name] = np.array([left.pop(name) for name in names])
    if left:
        raise ContidError(f"--goal: no column {', '.join(left)} for these robots")
    return goals
