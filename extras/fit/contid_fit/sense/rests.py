"""The rests of an arm in a recorded session: constant commands within one arming, with measured tips."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import Model
from contid.robot_file.robot import RobotDescription
from contid.targets import Actuation, Vec3
from contid.units import MM_PER_M
from contid_fit.sense.play import HysteresisSides

#: An arm settles for this time after its last command before its tip counts [s].
SETTLE_S: Final = 0.5
#: An interval with fewer measured tips is not a rest.
MIN_TIPS: Final = 10


@dataclass(frozen=True, eq=False, slots=True)
class RestInterval:
    """An interval of constant commands, after it settled.

    Attributes:
        times_s: times of the measurements, shape ``(n,)`` [s].
        since_s: time of the last change of a command before them.
        actuation: commanded [m or Pa].
        side: place of every axis between the branches of its hysteresis loop, -1 to 1; NaN where not known.
        reported: averages of what the devices reported [m or Pa]; NaN where they report nothing.
        tips: measured, in the base frame, shape ``(n, 3)`` [m].
    """

    times_s: Array
    since_s: float
    actuation: Actuation
    side: Actuation
    reported: Actuation
    tips: Array


def rests(
    rows: Iterable[Mapping[str, float]], name: str, robot: RobotDescription, model: Model
) -> Iterator[RestInterval]:
    """The rests of a robot in a session.

    Args:
        rows: ticks by column, as `contid.Session` gives them.
        name: name of the robot.
        robot: its description.
        model: its kinematics.
    """
    unit = robot.quantity.unit
    columns = [f"command.{name}.{axis.replace('.', '_')}_{unit}" for axis in robot.axis_names]
    measured = [f"sample.{name}.meas.{axis}_mm" for axis in "xyz"]
    reported = [f"sample.{name}.{axis.replace('.', '_')}.value_{unit}" for axis in robot.axis_names]
    frame, play = BaseFrame.of(robot.base), HysteresisSides(model)
    now: Actuation = ()
    side: Actuation = ()
    since_s = newest_s = -math.inf
    times: list[float] = []
    tips: list[Vec3] = []
    reports: list[list[float]] = []
    for row in rows:
        t_s = row["t_s"]
        command = tuple(robot.quantity.to_si(row[column]) for column in columns)
        disarmed = any(math.isnan(value) for value in command)
        if disarmed or command != now:
            if len(tips) >= MIN_TIPS:
                yield RestInterval(np.array(times), since_s, now, side, _average(reports), np.array(tips))
            now, since_s, times, tips, reports = command, t_s, [], [], []
            if disarmed:  # it may have moved: the same command later is another rest, which settles anew
                now = ()
                continue
            side = play.to(command)
        if t_s >= since_s + SETTLE_S:
            reports.append([robot.quantity.to_si(row.get(column, math.nan)) for column in reported])
        x, y, z = (row[column] / MM_PER_M for column in measured)
        age_s = row[f"sample.{name}.meas.age_s"]
        # A measurement stays in the records until the next one; its age grows with the time of the robots.
        captured_s = row["robot_s"] - age_s
        if not math.isnan(x + y + z + age_s) and abs(captured_s - newest_s) > 1e-6:
            newest_s = captured_s
            if t_s - age_s >= since_s + SETTLE_S:
                times.append(t_s - age_s)
                tips.append(frame.point_in_base((x, y, z)))
    if len(tips) >= MIN_TIPS:
        yield RestInterval(np.array(times), since_s, now, side, _average(reports), np.array(tips))


def _average(reports: list[list[float]]) -> Actuation:
    """Of every device over the reports that it made; one lost report does not count."""
    made = [[value for value in column if not math.isnan(value)] for column in zip(*reports, strict=True)]
    return tuple(sum(column) / len(column) if column else math.nan for column in made)
