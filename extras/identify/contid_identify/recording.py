"""A session as commands and measurements of one robot: what went out, axes, tip, each with its time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from contid.control.engine.tick_layout import ENABLED
from contid.control.tick.transmission import RobotTransmission
from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.frames import BaseFrame
from contid.robot_file.robot import RobotDescription
from contid.session.read import Session
from contid_identify.answer import CommandedTrace

#: Ticks of a recording at least.
LEAST_TICKS: Final = 100


@dataclass(frozen=True, eq=False)
class RobotRecording:
    """One robot of one session, from its first command to its end.

    Attributes:
        name: of the file.
        robot: description in the session.
        axes: names of all axes; the model's come first.
        period_s: of the ticks.
        sent: actuation that went to the devices [m or Pa], ``(ticks, axes)``; what was lost is held. While
            the devices were not enabled, as after a stop, it is what they measured, and what is measured
            then is left out below: a hand, the weight or a valve moved them, no command.
        axis_at_s, axis_measured: per axis the times [s], from the first command, and values [m or Pa] of its
            measurements.
        tip_at_s, tip_m: times and tips ``(n, 3)`` [m] that a tracker measured, in the base frame.
    """

    name: str
    robot: RobotDescription
    axes: tuple[str, ...]
    period_s: float
    sent: Array
    axis_at_s: tuple[Array, ...]
    axis_measured: tuple[Array, ...]
    tip_at_s: Array
    tip_m: Array

    @property
    def duration_s(self) -> float:
        """From the first command to the end [s]."""
        return len(self.sent) * self.period_s

    def axis_trace(self, axis: int) -> CommandedTrace:
        """Commands and measurements of one axis."""
        measured = self.axis_measured[axis][:, None]
        return CommandedTrace(self.period_s, self.sent[:, axis], self.axis_at_s[axis], measured, self.name)

    def tip_trace(self) -> CommandedTrace:
        """Commands of the model's axes, and measured tips."""
        count = len(self.robot.axis_names)
        return CommandedTrace(self.period_s, self.sent[:, :count], self.tip_at_s, self.tip_m, self.name)


def read_recording(path: Path, name: str) -> RobotRecording:
    """One robot of a session.

    Args:
        path: of the session.
        name: of the robot.

    Raises:
        SessionError: not a session.
        ContidError: no such robot, or it was not moved.
    """
    session = Session(path)
    names = [each.name for each in session.layout.robots]
    if name not in names:
        raise ContidError(f"{path}: robot {name}: choose with --robot; it has {', '.join(names)}")
    place = names.index(name)
    robot = session.robot_file().file.robots[name]
    transmission = RobotTransmission(robot)
    frame = BaseFrame.of(robot.base)
    count = len(robot.all_axis_names)
    period_s = 1.0 / session.rate_hz
    start_s, newest_s = -1.0, -np.inf
    sent: list[Array] = []
    axis_at: list[list[float]] = [[] for _ in range(count)]
    axis_values: list[list[float]] = [[] for _ in range(count)]
    tip_at: list[float] = []
    tips: list[tuple[float, float, float]] = []
    last = np.full(count, np.nan)
    for tick in session.ticks():
        record = tick.robots[place]
        device = [axis.device for axis in record.axes]
        values = transmission.to_actuation([axis.value for axis in record.axes])
        enabled = bool(record.flags & ENABLED)
        if np.isfinite(device).all():
            last = np.array(transmission.to_actuation(device))
        elif not sent:
            continue
        if not enabled and np.isfinite(values).all():
            last = np.array(values)
        if not sent:
            start_s = tick.deadline_s
        while len(sent) * period_s < tick.deadline_s - start_s - 0.5 * period_s:
            sent.append(sent[-1])  # skipped: the device goes on with what it has
        sent.append(last)
        if not enabled:
            continue
        for k, axis in enumerate(record.axes):
            fresh = axis.valid and np.isfinite(axis.time_s) and np.isfinite(values[k])
            if fresh and (not axis_at[k] or axis.time_s - start_s > axis_at[k][-1] + 1e-6):
                axis_at[k].append(axis.time_s - start_s)
                axis_values[k].append(values[k])
        captured_s = tick.deadline_s - record.measured_age_s - start_s
        # It stays in the records until the next one; its age grows with the time of the robots.
        by_ticks_s = (tick.tick - tick.skipped) * period_s - record.measured_age_s
        fresh = np.isfinite(captured_s) and np.isfinite(record.measured_tip_m).all()
        if fresh and abs(by_ticks_s - newest_s) > 1e-6 and (not tip_at or captured_s > tip_at[-1]):
            newest_s = by_ticks_s
            tip_at.append(captured_s)
            tips.append(frame.point_in_base(record.measured_tip_m))
    if len(sent) < LEAST_TICKS:
        raise ContidError(f"{path}: {name} has commands in {len(sent)} ticks; at least {LEAST_TICKS} needed")
    return RobotRecording(
        path.name, robot, robot.all_axis_names, period_s, np.array(sent),
        tuple(map(np.array, axis_at)), tuple(map(np.array, axis_values)),
        np.array(tip_at), np.array(tips).reshape(-1, 3),
    )  # fmt: skip
