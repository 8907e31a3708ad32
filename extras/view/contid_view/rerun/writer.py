"""Writes frames and events into a Rerun recording."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import rerun as rr

from contid.control.engine.events import RunEvent
from contid.control.engine.measured_tip import measured_tip_error_m
from contid.control.engine.tick_layout import RobotRecord
from contid.control.tick.config import RobotConfig
from contid.kinematics.array import Array
from contid.kinematics.model import Compliant
from contid.targets import load_or_zero
from contid.units import MM_PER_M
from contid_view import colours, paths
from contid_view.banner import Banner
from contid_view.event_line import event_line
from contid_view.frames import Frame
from contid_view.measured_shape import measured_shape
from contid_view.rerun.bars import RerunBars, bar_rows
from contid_view.rerun.bodies import RerunBody
from contid_view.rerun.stream import RerunStream, Strip
from contid_view.robot_scene import ARROW, RobotDrawing, RobotScene
from contid_view.scene import Scene, rope_line
from contid_view.shapes.compliance import RerunCompliance
from contid_view.shapes.load_arrow import RerunLoadArrow
from contid_view.shapes.obstacles import draw_obstacles

US_PER_S: Final = 1e6
_NO_POINT: Final = np.full((1, 3), np.nan)


class RerunWriter:
    """Writes one recording of the robots of one file."""

    def __init__(self, recording: rr.RecordingStream, scene: Scene, rate_hz: float) -> None:
        self._stream = stream = RerunStream(recording, rate_hz)
        self._scene = scene
        several = len(scene.robots) > 1
        self._bodies = [
            RerunBody(stream, robot.config.name, body, colours.of_robot(index))
            for index, (robot, body) in enumerate(zip(scene.robots, scene.bodies, strict=True))
        ]
        self._compliances = [
            RerunCompliance(stream, robot, robot.config.model)
            if isinstance(robot.config.model, Compliant)
            else None
            for robot in scene.robots
        ]
        self._loads = [
            None if robot.config.sensing is None else RerunLoadArrow(stream, robot, robot.config.sensing)
            for robot in scene.robots
        ]
        self._bars = [RerunBars(stream, rows, several) for rows in bar_rows(scene.robots)]
        self._banner = Banner([robot.config.name for robot in scene.robots])
        self._tick = 0
        self._log_static()
        self._show_banner(0)

    def _log_static(self) -> None:
        """Write what never changes: base frames, outlines, names and colours of the curves."""
        floor = rr.LineStrips3D(self._scene.floor(), colors=[colours.FLOOR], radii=rr.Radius.ui_points(0.5))
        self._stream.static(paths.FLOOR, floor)
        draw_obstacles(self._stream, self._scene.obstacles, self._scene.workspace())
        for index, robot in enumerate(self._scene.robots):
            name = robot.config.name
            origins, vectors = _arrows([robot.base], 2 * ARROW * robot.length_mm)
            self._stream.static(
                paths.body(name, "base"), rr.Arrows3D(origins=origins, vectors=vectors, colors=colours.AXES)
            )
            if robot.outline is not None:
                outline = rr.LineStrips3D(
                    [robot.outline], colors=[colours.REACH], radii=rr.Radius.ui_points(1.0)
                )
                self._stream.static(paths.body(name, "reach"), outline)
            for group, axes in robot.groups.items():
                names = robot.config.axis_names[axes]
                count = len(names)
                inks = [colours.of_axis(axes.start + k) for k in range(count)]
                curves = rr.SeriesLines(names=names, colors=inks, widths=[2.0] * count)
                self._stream.static(paths.plot(name, f"{group}command"), curves)
                names = tuple(f"{axis} measured" for axis in names)
                curves = rr.SeriesLines(names=names, colors=[colours.MEASURED] * count, widths=[0.75] * count)
                self._stream.static(paths.plot(name, f"{group}measured"), curves)
            errors = rr.SeriesLines(names=f"{name} commanded", colors=colours.of_robot(index)[0])
            self._stream.static(paths.plot(name, "tip_error"), errors)
            errors = rr.SeriesLines(names=f"{name} measured", colors=colours.MEASURED, widths=0.75)
            self._stream.static(paths.plot(name, "tip_error_measured"), errors)
        self._stream.static(paths.TIMING, rr.SeriesLines(names=paths.TIMES, colors=colours.CURVES[:2]))

    def write(self, frames: Sequence[Frame]) -> None:
        """Add frames, oldest first."""
        if not frames:
            return
        self._tick = frames[-1].record.tick
        ticks = [frame.record.tick for frame in frames]
        timing = [[frame.lateness_s * US_PER_S, frame.work_s * US_PER_S] for frame in frames]
        self._stream.scalars(paths.TIMING, ticks, timing)
        drawn = [frame for frame in frames if frame.drawn]
        drawn_ticks = [frame.record.tick for frame in drawn]
        drawings: dict[str, list[RobotDrawing | None]] = {}
        for index, robot in enumerate(self._scene.robots):
            self._curves(robot, ticks, [frame.record.robots[index] for frame in frames])
            if drawn:
                records = [frame.record.robots[index] for frame in drawn]
                drawings[robot.config.name] = self._space(index, robot, drawn_ticks, records)
        for rope in self._scene.ropes if drawn else ():
            lines = [rope_line(rope, {arm: drawings[arm][k] for arm in rope.arms}) for k in range(len(drawn))]
            self._stream.lines(paths.body(rope.name, "rope"), drawn_ticks, lines, colours.ROPE)

    def event(self, event: RunEvent) -> None:
        """Add an event of the ring, unless it is for programs only."""
        tick = int(getattr(event, "tick", self._tick))
        if (line := event_line(event)) is not None:
            text = f"{tick / self._stream.rate_hz:.3f} s   {line[1]}"
            self._stream.send(paths.EVENTS, [tick], rr.TextLog.columns(level=[line[0]], text=[text]))
        if self._banner.changed(event):
            self._show_banner(tick)

    def _show_banner(self, tick: int) -> None:
        columns = rr.TextDocument.columns(text=[self._banner.text()], media_type=["text/markdown"])
        self._stream.send(paths.BANNER, [tick], columns)

    def _curves(self, robot: RobotScene, ticks: Sequence[int], records: Sequence[RobotRecord]) -> None:
        """Lengths or pressures and the distance of the tip from its target, commanded and measured."""
        config = robot.config
        commands, samples = _commands(records), _samples(config, records)
        for what, rows in (("command", commands), ("measured", samples)):
            for group, axes in robot.groups.items():
                values = rows[:, axes] * [each.per_si for each in config.quantities[axes]]
                self._stream.scalars(paths.plot(config.name, group + what), ticks, values)
        errors = [[record.tip_error_m * MM_PER_M] for record in records]
        self._stream.scalars(paths.plot(config.name, "tip_error"), ticks, errors)
        errors = [
            [measured_tip_error_m(config, each) * MM_PER_M if math.isfinite(each.tip_error_m) else math.nan]
            for each in records
        ]
        self._stream.scalars(paths.plot(config.name, "tip_error_measured"), ticks, errors)

    def _space(
        self, index: int, robot: RobotScene, ticks: Sequence[int], records: Sequence[RobotRecord]
    ) -> list[RobotDrawing | None]:
        """Backbones, frames, target, trail and bars of range.

        Returns:
            The robot as commanded, or as measured before the first command.
        """
        config = robot.config
        commands, samples = _commands(records), _samples(config, records)
        self._bars[index].write(ticks, commands)
        loads = [load_or_zero(record.load_n) for record in records]
        commanded = [robot.drawing(tuple(q), load) for q, load in zip(commands.tolist(), loads, strict=True)]
        measured = [robot.drawing(tuple(q), load) for q, load in zip(samples.tolist(), loads, strict=True)]
        if (compliance := self._compliances[index]) is not None:
            tips = [_NO_POINT[0] if drawing is None else drawing.tip for drawing in commanded]
            compliance.write(ticks, [tuple(q) for q in commands.tolist()], loads, tips)
        self._body(robot, "backbone", ticks, commanded, colours.of_robot(index), 2.5)
        self._body(robot, "measured", ticks, measured, (colours.MEASURED, colours.MEASURED), 1.0)
        drawings = [a or b for a, b in zip(commanded, measured, strict=True)]
        self._bodies[index].write(ticks, [a or b for a, b in zip(measured, commanded, strict=True)])
        self._frames(robot, ticks, drawings)
        targets = [np.array([record.tip_m]) * MM_PER_M for record in records]
        self._stream.points(paths.body(config.name, "target"), ticks, targets, colours.TARGET, 7.0)
        tips = [_NO_POINT if drawing is None else drawing.tip[None] for drawing in measured]
        self._stream.points(paths.body(config.name, "trail"), ticks, tips, colours.TRAIL, 1.0)
        if (arrow := self._loads[index]) is not None:
            arrow.write(ticks, records, tips)
        self._tracked(robot, ticks, records, measured)
        return drawings

    def _tracked(
        self,
        robot: RobotScene,
        ticks: Sequence[int],
        records: Sequence[RobotRecord],
        measured: Sequence[RobotDrawing | None],
    ) -> None:
        """The tip that a tracker measured, and the curve to it; ``measured`` is drawn from the samples."""
        config = robot.config
        lengths = [None if drawing is None else drawing.backbone_mm for drawing in measured]
        shapes = [measured_shape(config, record, mm) for record, mm in zip(records, lengths, strict=True)]
        tips = [_NO_POINT if shape is None else shape.tip for shape in shapes]
        self._stream.points(paths.body(config.name, "tracked_tip"), ticks, tips, colours.TRACKED, 4.0)
        lines = [None if shape is None else shape.line for shape in shapes]
        self._stream.lines(paths.body(config.name, "tracked"), ticks, lines, colours.TRACKED)

    def _body(
        self,
        robot: RobotScene,
        part: str,
        ticks: Sequence[int],
        drawings: Sequence[RobotDrawing | None],
        inks: tuple[colours.Colour, colours.Colour],
        radius: float,
    ) -> None:
        """A robot in every frame: sections in its colours, tendons thin; nothing where it is unknown.

        The edges of a finger are not drawn: its racks are there.
        """
        strips: list[list[Strip]] = []
        for drawing in drawings:
            sections = 0 if drawing is None else drawing.sections
            lines = [] if drawing is None else drawing.strips[: sections if robot.planar else None]
            strips.append(
                [
                    (line, inks[k % 2], radius) if k < sections else (line, colours.EDGES, 0.5 * radius)
                    for k, line in enumerate(lines)
                ]
            )
        self._stream.strips(paths.body(robot.config.name, part), ticks, strips)

    def _frames(
        self, robot: RobotScene, ticks: Sequence[int], drawings: Sequence[RobotDrawing | None]
    ) -> None:
        """Frames at the end of the first section and at the tip."""
        shown = [(tick, each) for tick, each in zip(ticks, drawings, strict=True) if each is not None]
        if not shown:
            return
        count = len(shown[0][1].frames)
        frames = [frame for _, drawing in shown for frame in drawing.frames[:count]]
        origins, vectors = _arrows(frames, ARROW * robot.length_mm)
        columns = rr.Arrows3D.columns(
            origins=origins, vectors=vectors, colors=[*colours.AXES] * len(frames)
        ).partition([3 * count] * len(shown))
        self._stream.send(paths.body(robot.config.name, "frames"), [tick for tick, _ in shown], columns)


def _arrows(frames: Sequence[Array], length_mm: float) -> tuple[Array, Array]:
    """Origins and vectors of the axes of frames, each (3 n, 3) [mm]."""
    stacked = np.array(frames)
    return np.repeat(stacked[:, 0], 3, axis=0), stacked[:, 1:].reshape(-1, 3) * length_mm


def _commands(records: Sequence[RobotRecord]) -> Array:
    """The commanded actuation [m or Pa], a row per record."""
    return np.array([[axis.command for axis in record.axes] for record in records])


def _samples(config: RobotConfig, records: Sequence[RobotRecord]) -> Array:
    """The measured actuation [m or Pa], a row per record."""
    values = (tuple(axis.value for axis in record.axes) for record in records)
    return np.array([config.transmission.to_actuation(each) for each in values])
