"""Writes frames and events into a Rerun recording; the only place that knows how a robot is drawn there.

Everything of a batch goes column by column (`send_columns`), which costs a tenth of row by row.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from contid.control.engine.tick_layout import RobotRecord
from contid.control.tick.config import RobotConfig
from contid.targets import Vec3
from contid.units import MM_PER_M
from contid.view import paths
from contid.view.frames import Frame
from contid.view.measured_shape import sight
from contid.view.scene import ARM, Look, Scene
from contid.view.stage import Stage

Colour = tuple[int, int, int]
US_PER_S: Final = 1e6
#: One per robot: first section, second section.
SECTIONS: Final[tuple[tuple[Colour, Colour], ...]] = (
    ((64, 156, 255), (134, 205, 255)),
    ((255, 150, 50), (255, 200, 120)),
    ((110, 205, 110), (175, 235, 165)),
    ((205, 130, 255), (230, 190, 255)),
)
#: One per axis.
CURVES: Final[tuple[Colour, ...]] = (
    (64, 156, 255), (255, 120, 90), (110, 205, 110), (205, 130, 255), (240, 200, 60), (70, 210, 210),
    (255, 150, 200), (150, 150, 255), (190, 160, 120),
)  # fmt: skip
MEASURED: Final[Colour] = (190, 190, 190)
TRACKED: Final[Colour] = (70, 225, 200)
EDGES: Final[Colour] = (120, 130, 140)
TARGET: Final[Colour] = (255, 70, 90)
TRAIL: Final[Colour] = (255, 214, 64)
REACH: Final[Colour] = (75, 85, 95)
FLOOR: Final[Colour] = (48, 52, 57)
ROPE: Final[Colour] = (215, 175, 125)
AXES: Final[tuple[Colour, ...]] = ((230, 70, 70), (80, 200, 90), (80, 120, 255))

LEVELS: Final = {
    "fault": "ERROR",
    "failed": "ERROR",
    "refused": "WARN",
    "bus": "WARN",
    "device": "WARN",
    "stall": "WARN",
    "skipped": "WARN",
    "viewer": "WARN",
}
#: Events for machines: they would bury the others.
SILENT: Final = frozenset({"answer", "limit_name", "mark", "order", "report", "robot"})


class RerunWriter:
    """One recording of the robots of one file."""

    def __init__(self, recording: rr.RecordingStream, stage: Stage, rate_hz: float) -> None:
        self._recording = recording
        self._stage = stage
        self._scenes = stage.scenes
        self._rate_hz = rate_hz
        self._tick = 0
        self._drawn: dict[str, bool] = {}
        self._begin()

    def _begin(self) -> None:
        """What never changes: base frames, limits, names and colours of the curves."""
        log = self._recording.log
        floor = rr.LineStrips3D(self._stage.floor(), colors=[FLOOR], radii=rr.Radius.ui_points(0.5))
        log(paths.FLOOR, floor, static=True)
        self._drawn |= {paths.body(rope.guard.name, "rope"): True for rope in self._stage.ropes}
        for index, scene in enumerate(self._scenes):
            config = scene.config
            # Their first row says that there is nothing yet: what the layout shows, exists.
            self._drawn |= {paths.body(config.name, part): True for part in ("tracked", "tracked_tip")}
            log(
                paths.body(config.name, "base"), _arrows([scene.base], 2 * ARM * scene.length_mm), static=True
            )
            if scene.outline is not None:
                outline = rr.LineStrips3D([scene.outline], colors=[REACH], radii=rr.Radius.ui_points(1.0))
                log(paths.body(config.name, "reach"), outline, static=True)
            for group, axes in scene.groups.items():
                names = config.axis_names[axes]
                inks = [CURVES[k % len(CURVES)] for k in range(len(names))]
                curves = rr.SeriesLines(names=names, colors=inks, widths=[2.0] * len(inks))
                log(paths.plot(config.name, f"{group}command"), curves, static=True)
                names = tuple(f"{axis} measured" for axis in names)
                curves = rr.SeriesLines(names=names, colors=[MEASURED] * len(inks), widths=[0.75] * len(inks))
                log(paths.plot(config.name, f"{group}measured"), curves, static=True)
            error = rr.SeriesLines(
                names=f"{config.name} commanded", colors=SECTIONS[index % len(SECTIONS)][0]
            )
            log(paths.plot(config.name, "tip_error"), error, static=True)
            error = rr.SeriesLines(names=f"{config.name} measured", colors=MEASURED, widths=0.75)
            log(paths.plot(config.name, "tip_error_measured"), error, static=True)
        log(paths.TIMING, rr.SeriesLines(names=paths.TIMES, colors=CURVES[:2]), static=True)

    def write(self, frames: Sequence[Frame]) -> None:
        """Add frames, oldest first."""
        if not frames:
            return
        self._tick = frames[-1].record.tick
        ticks = [frame.record.tick for frame in frames]
        timing = [[frame.lateness_s * US_PER_S, frame.work_s * US_PER_S] for frame in frames]
        self._scalars(paths.TIMING, ticks, timing)
        drawn = [k for k, frame in enumerate(frames) if frame.drawn]
        looks = []
        for index, scene in enumerate(self._scenes):
            records = [frame.record.robots[index] for frame in frames]
            self._curves(scene, ticks, records)
            if drawn:
                looks.append(
                    self._space(index, scene, [ticks[k] for k in drawn], [records[k] for k in drawn])
                )
        if drawn:
            self._ropes([ticks[k] for k in drawn], list(zip(*looks, strict=True)))

    def event(self, event: Mapping[str, Any]) -> None:
        """Add an event of the ring, unless it is for machines only."""
        kind = event["event"]
        if kind in SILENT:
            return
        text = _words({name: value for name, value in event.items() if name != "tick" and value != ""})
        columns = rr.TextLog.columns(text=[text], level=[LEVELS.get(kind, "INFO")])
        self._send(paths.EVENTS, [int(event.get("tick", self._tick))], columns)

    def _curves(self, scene: Scene, ticks: Sequence[int], records: Sequence[RobotRecord]) -> None:
        """Lengths or pressures and the distance of the tip from its target, commanded and measured."""
        config = scene.config
        commands, samples = _commands(records), _samples(config, records)
        for what, rows in (("command", commands), ("measured", samples)):
            for group, axes in scene.groups.items():
                self._scalars(
                    paths.plot(config.name, group + what), ticks, rows[:, axes] * config.quantity.per_si
                )
        errors = [[record.tip_error_m * MM_PER_M] for record in records]
        self._scalars(paths.plot(config.name, "tip_error"), ticks, errors)
        errors = [[_off(config, *each) * MM_PER_M] for each in zip(records, samples, strict=True)]
        self._scalars(paths.plot(config.name, "tip_error_measured"), ticks, errors)

    def _space(
        self, index: int, scene: Scene, ticks: Sequence[int], records: Sequence[RobotRecord]
    ) -> list[Look | None]:
        """Backbones, frames, target and trail; bars. Returns what was commanded, or measured before that."""
        config = scene.config
        commands, samples = _commands(records), _samples(config, records)
        if not scene.planar:
            self._range(index, scene, ticks, commands)
        loads = [_known(record.load_n) for record in records]
        wanted = [scene.look(tuple(q), load) for q, load in zip(commands.tolist(), loads, strict=True)]
        seen = [scene.look(tuple(q), load) for q, load in zip(samples.tolist(), loads, strict=True)]
        self._body(scene, "backbone", ticks, wanted, SECTIONS[index % len(SECTIONS)], 2.5)
        self._body(scene, "measured", ticks, seen, (MEASURED, MEASURED), 1.0)
        looks = [a or b for a, b in zip(wanted, seen, strict=True)]
        self._frames(scene, ticks, looks)
        targets = [np.array([record.tip_m]) * MM_PER_M for record in records]
        self._points(paths.body(config.name, "target"), ticks, targets, TARGET, 7.0)
        tips = [np.full((1, 3), np.nan) if look is None else look.tip[None] for look in seen]
        self._points(paths.body(config.name, "trail"), ticks, tips, TRAIL, 1.0)
        self._tracked(scene, ticks, records, seen)
        return looks

    def _tracked(
        self, scene: Scene, ticks: Sequence[int], records: Sequence[RobotRecord], looks: Sequence[Look | None]
    ) -> None:
        """What a tracker sees, and the curve through it; ``looks`` are what the samples say."""
        config = scene.config
        lengths = [None if look is None else scene.backbone_mm(look) for look in looks]
        sights = [sight(config, record, mm) for record, mm in zip(records, lengths, strict=True)]
        tips = [np.full((1, 3), np.nan) if seen is None else seen.tip for seen in sights]
        self._points(paths.body(config.name, "tracked_tip"), ticks, tips, TRACKED, 4.0)
        lines = [None if seen is None else seen.line for seen in sights]
        self._lines(paths.body(config.name, "tracked"), ticks, lines, TRACKED)

    def _ropes(self, ticks: Sequence[int], looks: Sequence[Sequence[Look | None]]) -> None:
        """The ropes between the arms of closed chains, none where they do not reach."""
        for rope in self._stage.ropes:
            self._lines(paths.body(rope.guard.name, "rope"), ticks, [rope.line(each) for each in looks], ROPE)

    def _lines(
        self, entity: str, ticks: Sequence[int], lines: Sequence[NDArray[np.float64] | None], ink: Colour
    ) -> None:
        """One curve per frame, or none."""
        keep = self._changes(entity, [line is not None for line in lines])
        if not keep:
            return
        shown = [[] if (line := lines[k]) is None else [line.tolist()] for k in keep]
        count = sum(map(len, shown))
        columns = rr.LineStrips3D.columns(
            strips=[strip for each in shown for strip in each],
            colors=[ink] * count,
            radii=rr.Radius.ui_points([1.5] * count) if count else [],
        ).partition([len(each) for each in shown])
        self._send(entity, [ticks[k] for k in keep], columns)

    def _body(
        self,
        scene: Scene,
        part: str,
        ticks: Sequence[int],
        looks: Sequence[Look | None],
        colours: tuple[Colour, Colour],
        radius: float,
    ) -> None:
        """Strips of every frame: sections in the robot's colours, edges thin; none where it is unknown."""
        entity = paths.body(scene.config.name, part)
        keep = self._changes(entity, [look is not None for look in looks])
        shown = [looks[k] for k in keep]
        strips = [[] if look is None else [strip.tolist() for strip in look.strips] for look in shown]
        edges = 2 if scene.outline is not None else 0
        inks: list[Colour] = []
        radii: list[float] = []
        for each in strips:
            sections = max(len(each) - edges, 0)
            inks += [colours[k % 2] for k in range(sections)] + [EDGES] * (len(each) - sections)
            radii += [radius] * sections + [0.5 * radius] * (len(each) - sections)
        if not keep:
            return
        columns = rr.LineStrips3D.columns(
            strips=[strip for each in strips for strip in each],
            colors=inks,
            radii=rr.Radius.ui_points(radii) if radii else [],
        ).partition([len(each) for each in strips])
        self._send(entity, [ticks[k] for k in keep], columns)

    def _frames(self, scene: Scene, ticks: Sequence[int], looks: Sequence[Look | None]) -> None:
        """Frames at the end of the first section and at the tip."""
        entity = paths.body(scene.config.name, "frames")
        shown = [(tick, look) for tick, look in zip(ticks, looks, strict=True) if look is not None]
        if not shown:
            return
        count = len(shown[0][1].frames)
        frames = np.array([frame for _, look in shown for frame in look.frames[:count]])
        columns = rr.Arrows3D.columns(
            origins=np.repeat(frames[:, 0], 3, axis=0),
            vectors=frames[:, 1:].reshape(-1, 3) * ARM * scene.length_mm,
            colors=[*AXES] * len(frames),
        ).partition([3 * count] * len(shown))
        self._send(entity, [tick for tick, _ in shown], columns)

    def _points(
        self,
        entity: str,
        ticks: Sequence[int],
        points: Sequence[NDArray[np.float64]],
        ink: Colour,
        size: float,
    ) -> None:
        """One point per frame, or none."""
        known = [bool(np.isfinite(point).all()) for point in points]
        keep = self._changes(entity, known)
        if not keep:
            return
        shown = [points[k] for k in keep if known[k]]
        columns = rr.Points3D.columns(
            positions=np.vstack(shown) if shown else np.zeros((0, 3)),
            colors=[ink] * len(shown),
            radii=rr.Radius.ui_points([size] * len(shown)) if shown else [],
        ).partition([int(known[k]) for k in keep])
        self._send(entity, [ticks[k] for k in keep], columns)

    def _range(self, index: int, scene: Scene, ticks: Sequence[int], commands: NDArray[np.float64]) -> None:
        """How much of its range every axis uses [%], as bars."""
        low, high = np.array(scene.config.model.lower), np.array(scene.config.model.upper)
        used = 100.0 * (commands - low) / (high - low)
        known = np.isfinite(used).all(axis=1)
        left, ink = np.arange(len(low)) + 0.5, SECTIONS[index % len(SECTIONS)][0]  # bars about 1, 2, 3
        for tick, row in zip(np.array(ticks)[known].tolist(), used[known], strict=True):
            self._recording.set_time(paths.TICK, sequence=tick)
            self._recording.set_time(paths.TIME, duration=tick / self._rate_hz)
            self._recording.log(
                paths.plot(scene.config.name, "range"), rr.BarChart(row, abscissa=left, color=ink)
            )

    def _scalars(self, entity: str, ticks: Sequence[int], values: Any) -> None:
        """Rows of equally many curves; rows with an unknown value are left out."""
        rows = np.asarray(values, dtype=np.float64)
        known = np.isfinite(rows).all(axis=1)
        if known.any():
            self._send(entity, np.array(ticks)[known].tolist(), rr.Scalars.columns(scalars=rows[known]))

    def _changes(self, entity: str, known: Sequence[bool]) -> list[int]:
        """Frames to write: those that show something, and the first that does not any more."""
        keep = []
        for k, is_known in enumerate(known):
            if is_known or self._drawn.get(entity, False):
                keep.append(k)
            self._drawn[entity] = is_known
        return keep

    def _send(self, entity: str, ticks: Sequence[int], columns: Any) -> None:
        seconds = np.array(ticks) / self._rate_hz
        times = [rr.TimeColumn(paths.TICK, sequence=ticks), rr.TimeColumn(paths.TIME, duration=seconds)]
        self._recording.send_columns(entity, indexes=times, columns=columns)


def _arrows(frames: Sequence[NDArray[np.float64]], length_mm: float) -> rr.Arrows3D:
    stacked = np.array(frames)
    return rr.Arrows3D(
        origins=np.repeat(stacked[:, 0], 3, axis=0),
        vectors=stacked[:, 1:].reshape(-1, 3) * length_mm,
        colors=[*AXES] * len(frames),
    )


def _commands(records: Sequence[RobotRecord]) -> NDArray[np.float64]:
    """What was commanded [m or Pa], a row per record."""
    return np.array([[axis.command for axis in record.axes] for record in records])


def _samples(config: RobotConfig, records: Sequence[RobotRecord]) -> NDArray[np.float64]:
    """The actuation [m or Pa] that was measured, a row per record."""
    values = (tuple(axis.value for axis in record.axes) for record in records)
    return np.array([config.transmission.to_actuation(each) for each in values])


def _off(config: RobotConfig, record: RobotRecord, sample: NDArray[np.float64]) -> float:
    """Distance [m] of the target from the tip as the model has it for a sample; nan unless it is followed."""
    if not (np.isfinite(sample).all() and math.isfinite(record.tip_error_m)):
        return math.nan
    load = config.frame.vector_in_base(_known(record.load_n))
    pose = config.model.forward(tuple(sample.tolist()), load)
    return math.dist(config.frame.point_in_world(pose.tip_m), record.tip_m)


def _known(load_n: Vec3) -> Vec3:
    """A load, or none where the record has none."""
    return load_n if all(map(math.isfinite, load_n)) else (0.0, 0.0, 0.0)


def _words(event: Mapping[str, Any]) -> str:
    """One line: whom it is about, what happened, what is known about it."""
    rest = dict(event)
    kind = rest.pop("event")
    robot = rest.pop("robot", None)
    said = rest.pop("message", None)
    rounded = {name: f"{value:.4g}" if isinstance(value, float) else value for name, value in rest.items()}
    details = ", ".join(f"{name} {value}" for name, value in rounded.items())
    line = str(said) if said is not None else f"{kind}{': ' if details else ''}{details}"
    return line if robot is None else f"{robot}: {line}"
