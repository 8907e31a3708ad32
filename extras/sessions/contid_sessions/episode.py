"""A session as an episode of a dataset: measured axes, commanded axes and measured tips of every frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.session.format.channels import MEASURED
from contid.session.read import Session
from contid_sessions.measured import measured_robots
from contid_sessions.table import TickTable

#: Features; names are LeRobot's.
STATE: Final = "observation.state"
ACTION: Final = "action"
TIP: Final = "observation.tip"


@dataclass(frozen=True)
class Episode:
    """A session as an episode of a data set.

    Attributes:
        values: rows by feature, float32.
        repeated: frames in which a device did not answer; they repeat its last value.
    """

    values: dict[str, Any]
    repeated: int

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.values[STATE])


def feature_names(session: Session) -> dict[str, list[str]]:
    """Names of the elements by feature.

    Raises:
        ContidError: this version of contid refuses the robot file of the session.
    """
    robots = measured_robots(session)
    if not robots:
        raise ContidError(f"{session.path}: this version of contid refuses its robot file")
    axes = [name for robot in robots for name in robot.names[: len(robot.config.axis_names)]]
    tips = [name for robot in robots for name in robot.names[len(robot.config.axis_names) :]]
    return {STATE: axes, ACTION: axes, TIP: tips}


def read_episode(session: Session, names: dict[str, list[str]], step: int) -> Episode:
    """The frames of a session.

    Args:
        session: session to read.
        names: names of the elements by feature.
        step: every how many-th tick is a frame.

    Raises:
        ContidError: no tick has a command and a measurement of every axis.
    """
    table = TickTable(session)
    place = {name: index for index, name in enumerate(table.names)}
    fronts = {STATE: MEASURED, ACTION: "command", TIP: MEASURED}
    columns = {key: [place[_column_name(fronts[key], name)] for name in each] for key, each in names.items()}
    chosen = sorted({index for each in columns.values() for index in each})
    blocks = [block[:, chosen] for block in table.blocks()]
    rows = np.concatenate(blocks) if blocks else np.empty((0, len(chosen)))
    known = np.flatnonzero(np.isfinite(rows).all(axis=1))
    if not len(known):
        raise ContidError(f"{session.path}: no tick has a command and a measurement of every axis")
    rows = rows[known[0] : known[-1] + 1 : step]
    repeated = _repeat_last(rows)
    where = {index: at for at, index in enumerate(chosen)}
    values = {
        key: rows[:, [where[index] for index in each]].astype(np.float32) for key, each in columns.items()
    }
    return Episode(values, repeated)


def _column_name(front: str, name: str) -> str:
    """The column of a measured name; channels write an underscore for the dot of an axis."""
    if front == MEASURED:
        return f"{front}.{name}"
    robot, _, axis = name.partition(".")
    return f"{front}.{robot}.{axis.replace('.', '_')}"


def _repeat_last(rows: Array) -> int:
    """Fill what is absent with the value before it; the number of rows that were not complete."""
    incomplete = ~np.isfinite(rows).all(axis=1)
    for row in np.flatnonzero(incomplete):
        rows[row] = np.where(np.isfinite(rows[row]), rows[row], rows[row - 1])
    return int(incomplete.sum())
