"""Commands and measured values of every axis over time, drawn by matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from contid.errors import MissingExtraError
from contid_sessions.columns import RecordedTicks
from contid_sessions.table import TickTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_axes(session: RecordedTicks) -> Figure:
    """A figure of pyplot with one diagram per robot; an axis is a colour, its measured values are dashed.

    Pyplot keeps it until it is closed, and a notebook shows it.

    Raises:
        MissingExtraError: matplotlib is not installed.
        SessionError: this version of contid refuses the robot file, which measured values need.
    """
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise MissingExtraError("plot", "matplotlib", "plots") from None
    session.robot_file()
    table, robots = TickTable(session), session.layout.robots
    # Of every axis the index of its robot, and its column without channel and robot.
    axes = [
        (number, f"{axis}_{unit}")
        for number, robot in enumerate(robots)
        for axis, unit in zip(robot.axes, robot.units, strict=True)
    ]
    # Of every axis two neighbouring columns of values: commanded, measured.
    names = [
        f"{channel}.{robots[number].name}.{axis}"
        for number, axis in axes
        for channel in ("command", "measured")
    ]
    places = [table.names.index(name) for name in ("t_s", *names)]
    values = np.concatenate([np.empty((0, len(places))), *(block[:, places] for block in table.blocks())])
    figure: Figure = plt.figure(layout="constrained", figsize=(8.0, 1.0 + 2.6 * len(robots)))
    diagrams = figure.subplots(len(robots), sharex=True, squeeze=False)
    t_s, pairs = values[:, 0], np.split(values[:, 1:], len(axes), axis=1)
    for (number, axis), pair in zip(axes, pairs, strict=True):
        (line,) = diagrams[number, 0].plot(t_s, pair[:, 0], label=axis)
        diagrams[number, 0].plot(t_s, pair[:, 1], color=line.get_color(), linestyle="--", linewidth=1.0)
    for robot, (diagram,) in zip(robots, diagrams, strict=True):
        units = " and ".join(dict.fromkeys(robot.units))
        diagram.set(title=f"{robot.name}: commanded, and dashed: measured", ylabel=f"axes [{units}]")
        diagram.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        diagram.grid(alpha=0.3)
    diagrams[-1, 0].set_xlabel("t [s]")
    return figure
