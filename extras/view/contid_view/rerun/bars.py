"""Bars that show where every axis is in its range, with its name, as a drawing in two dimensions.

A row per axis: its name, the range as a dark track, and the bar in the colour of the axis' curve. Rerun's
bar chart has numbers for names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
import rerun as rr

from contid.kinematics.array import Array
from contid_view import paths
from contid_view.colours import TEXT, TRACK, of_axis
from contid_view.rerun.stream import RerunStream
from contid_view.robot_scene import RobotScene

#: Size of a bar: width of the whole range, height of a row and of the bar in it.
WIDTH, ROW, HEIGHT = 100.0, 6.0, 4.0
#: Room for the names on the left and for the ends of the ranges on the right.
LEFT, RIGHT = 16.0, 12.0
#: Rerun writes a label below its point.
LABEL_DROP = 0.5 * ROW


@dataclass(frozen=True, slots=True)
class BarRows:
    """The rows of one robot among those of all robots of a file."""

    robot: RobotScene
    first: int

    @property
    def count(self) -> int:
        """One per axis."""
        return len(self.robot.config.axis_names)

    @property
    def heights(self) -> Array:
        """Middle of every row."""
        return np.asarray((self.first + np.arange(self.count) + 0.5) * ROW)


def bar_rows(robots: Sequence[RobotScene]) -> list[BarRows]:
    """The rows of all robots, one below the other."""
    firsts = accumulate((len(robot.config.axis_names) for robot in robots), initial=0)
    return [BarRows(robot, first) for robot, first in zip(robots, firsts, strict=False)]


class RerunBars:
    """The bars of one robot in a recording."""

    def __init__(self, stream: RerunStream, rows: BarRows, several: bool) -> None:
        self._stream, self._rows = stream, rows
        config, middles, count = rows.robot.config, rows.heights, rows.count
        self._lower, self._upper = np.array(config.model.lower), np.array(config.model.upper)
        self._entity = paths.plot(config.name, "range")
        prefix = f"{config.name}." if several else ""
        names = [prefix + name for name in config.axis_names]
        tracks = rr.Boxes2D(
            centers=np.column_stack([np.full(count, 0.5 * WIDTH), middles]),
            half_sizes=np.tile([0.5 * WIDTH, 0.5 * HEIGHT], (count, 1)),
            colors=[TRACK],
            radii=rr.Radius.ui_points(1.0),
            draw_order=-1.0,
        )
        stream.static(paths.plot(config.name, "range_tracks"), tracks)
        labels = rr.Points2D(
            positions=np.column_stack([np.full(count, -0.5 * LEFT), middles - LABEL_DROP]),
            labels=names,
            show_labels=True,
            colors=[TEXT],
            radii=rr.Radius.ui_points(0.0),
        )
        stream.static(paths.plot(config.name, "range_names"), labels)
        colours = [of_axis(k) for k in range(count)]
        look = rr.LineStrips2D.from_fields(colors=colours, radii=0.5 * HEIGHT * 0.8)
        stream.static(self._entity, look)

    def write(self, ticks: Sequence[int], commands: Array) -> None:
        """The bars at every tick with a command; ``commands`` are (n, axes) [m or Pa]."""
        share = np.clip((commands - self._lower) / (self._upper - self._lower), 0.0, 1.0)
        finite = np.isfinite(share).all(axis=1)
        if not finite.any():
            return
        share, count = share[finite], self._rows.count
        lines = np.zeros((len(share), count, 2, 2), dtype=np.float32)
        lines[..., 1] = self._rows.heights[None, :, None]
        lines[:, :, 1, 0] = np.maximum(share * WIDTH, 0.2)
        columns = rr.LineStrips2D.columns(strips=lines.reshape(-1, 2, 2)).partition([count] * len(share))
        self._stream.send(self._entity, np.array(ticks)[finite].tolist(), columns)
