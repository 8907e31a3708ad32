"""A trajectory of a robot file as commands that lead it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from contid.errors import ContidError
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import build_model
from contid_dynamics.lead import answer_of, led, within

if TYPE_CHECKING:
    from contid.robot_file.load import LoadedFile
    from contid.trajectory.timed import Trajectory

#: Greatest residual of the model at a row [m].
_RESIDUAL_M = 1e-4


@dataclass(frozen=True)
class LedFile:
    """The commands as text.

    Attributes:
        text: CSV with the axes of the model.
        rows: how many.
        later_s: by how much the robot does the path later.
    """

    text: str
    rows: int
    later_s: float


def led_file(loaded: LoadedFile, trajectory: Trajectory, body: bool = True) -> LedFile:
    """Commands at the rate of the file.

    Args:
        loaded: with one robot, which has ``dynamics``.
        trajectory: its path.
        body: also for the first mode, at the mean of the path.

    Raises:
        ContidError: the robot has no ``dynamics`` or extra axes, a row is out of reach, or the lead is beyond
            the limits.
    """
    ((name, robot),) = loaded.driven.items()
    if robot.extra_axis_names:
        raise ContidError(f"{name}: a lead is for the axes of the model; it has extra ones as well")
    model, frame = build_model(robot), BaseFrame.of(robot.base)
    period_s = 1.0 / loaded.file.rate_hz
    times_s = np.array([trajectory.time_of_row(row) for row in range(len(trajectory))])
    seed, rows = robot.rest, []
    for at_s in times_s.tolist():
        target = trajectory.targets_at(at_s)[name]
        answer = model.inverse(frame.target_in_base(target), seed)
        if answer.residual_m > _RESIDUAL_M:
            raise ContidError(f"{name}: the path is out of reach at {at_s:.3f} s; contid check shows where")
        seed = answer.actuation
        rows.append(seed)
    path = np.array(rows)
    lags = answer_of(robot, path.mean(axis=0).tolist(), body)
    commands = robot.quantity.from_si(
        within(robot, name, led(path, period_s, lags, times_s - times_s[0]), period_s)
    )
    lines = [",".join(("t_s", *robot.columns))]
    lines += [
        f"{tick * period_s:.6g}," + ",".join(f"{value:.9g}" for value in row)
        for tick, row in enumerate(commands.tolist())
    ]
    return LedFile("\n".join(lines) + "\n", len(commands), max(lags.delay_s))
