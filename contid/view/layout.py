"""The layout (Rerun calls it blueprint) for the robots of one file: what is shown where, from which side.

Planar robots are seen from straight above, others from the side with what is up for them up. Every view
names its entities, so what it shows can be checked against a recording.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from contid.view import paths
from contid.view.scene import Array, Scene
from contid.view.stage import Stage

#: Seconds of trail behind a tip, and of a plot while the robot runs.
TRAIL_S: Final = 5.0
WINDOW_S: Final = 20.0
#: Side views come from here: ahead of the robot, to its right, somewhat above.
ASIDE: Final = (0.8, -1.0, 0.35)
#: What the eye sees at a distance of 1, to the right and upwards, less a margin.
SEEN: Final = np.array([1.35, 0.97])
#: More plots than this go behind tabs.
STACKED: Final = 2
#: Distances of the tip from its target.
TIP_ERRORS: Final = ("tip_error", "tip_error_measured")
#: The names of more curves than this would hide them; the pointer tells them too.
LEGEND: Final = 3


def build_layout(stage: Stage, live: bool, finished: bool) -> rrb.Blueprint:
    """The layout.

    Args:
        stage: what there is to draw.
        live: drawn while the robots run: plots show the last seconds, and how late the ticks are.
        finished: looked at when the run is over: it plays from its beginning.
    """
    scenes = stage.scenes
    ranges = [_last(WINDOW_S)] if live else None
    names = [scene.config.name for scene in scenes]
    actuation = [_actuation(scene, ranges) for scene in scenes]
    plots: list[Any] = actuation if len(actuation) <= STACKED else [rrb.Tabs(*actuation)]
    bars = [_bars(scene) for scene in scenes if not scene.planar]
    error = rrb.TimeSeriesView(
        name="tip off its target [mm]",
        contents=_contents(paths.plot(name, what) for name in names for what in TIP_ERRORS),
        plot_legend=rrb.PlotLegend(corner="RightBottom"),
        time_ranges=ranges,
    )
    timing = rrb.TimeSeriesView(
        name="lateness and work of the ticks [us]", contents=_contents([paths.TIMING]), time_ranges=ranges
    )
    events = rrb.TextLogView(
        name="events",
        contents=_contents([paths.EVENTS]),
        columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"]),
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(_space(stage), events, row_shares=[4, 1]),
            rrb.Vertical(*plots, rrb.Tabs(timing, error, active_tab=0 if live else 1), *bars),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(
            state="collapsed",
            timeline=paths.TIME,
            play_state="playing" if finished else "following",
            loop_mode="all" if finished else "off",
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def shown(part: Any) -> Iterator[str]:
    """Entities that a layout, or a part of one, shows."""
    if isinstance(part, rrb.Blueprint):
        yield from shown(part.root_container)
    elif isinstance(part, rrb.Container):
        for child in part.contents:
            yield from shown(child)
    else:
        for expression in part.contents:
            yield expression.removeprefix("+ /")


def _contents(entities: Iterator[str] | Sequence[str]) -> list[str]:
    return [f"+ /{entity}" for entity in entities]


def _last(seconds: float) -> rrb.VisibleTimeRange:
    return rrb.VisibleTimeRange(
        paths.TIME,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-seconds),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )


def _actuation(scene: Scene, ranges: Any) -> rrb.TimeSeriesView | rrb.Tabs:
    config = scene.config
    views = []
    for group, axes in scene.groups.items():
        names = config.axis_names[axes]
        what = ", ".join(names) if group else f"{config.quantity}s"
        view = rrb.TimeSeriesView(
            name=f"{config.name}: {what} [{config.quantity.unit}]",
            contents=_contents(paths.plot(config.name, group + curve) for curve in ("command", "measured")),
            plot_legend=rrb.PlotLegend(visible=len(names) <= LEGEND),
            time_ranges=ranges,
        )
        views.append(view)
    return views[0] if len(views) == 1 else rrb.Tabs(*views, active_tab=0)


def _bars(scene: Scene) -> rrb.BarChartView:
    name = scene.config.name
    return rrb.BarChartView(
        name=f"{name}: range in use [%], axis by axis",
        contents=_contents([paths.plot(name, "range")]),
        plot_legend=rrb.PlotLegend(visible=False),
    )


def _space(stage: Stage) -> rrb.Spatial3DView:
    scenes = stage.scenes
    entities, trails = [paths.FLOOR], {}
    for scene in scenes:
        parts = ["base", "backbone", "measured", "tracked", "tracked_tip", "frames", "target", "trail"]
        parts += ["reach"] if scene.outline is not None else []
        entities += [paths.body(scene.config.name, part) for part in parts]
        behind = rrb.VisibleTimeRanges([_last(TRAIL_S)])
        trails[paths.body(scene.config.name, "trail")] = [rr.Points3D.from_fields().visualizer(), behind]
    entities += [paths.body(rope.guard.name, "rope") for rope in stage.ropes]
    eye, target, up = eye_of(stage)
    return rrb.Spatial3DView(
        name=f"{', '.join(scene.config.name for scene in scenes)}: grid of {stage.cell_mm:g} mm",
        origin="/",
        contents=_contents(entities),
        overrides=trails,
        background=rrb.Background(color=(22, 24, 27)),
        line_grid=rrb.LineGrid3D(visible=False),  # endless: its far lines are a thicket
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye,
            look_target=target,
            eye_up=up,
        ),
    )


def eye_of(stage: Stage) -> tuple[Array, Array, Array]:
    """Where the eye is, where it looks [mm], and what is up for it: so as to see what robots do."""
    seen = stage.seen()
    centre = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    up = np.array([0.0, 1.0, 0.0] if stage.planar else stage.scenes[0].up)
    aside = np.array([0.0, 0.0, 1.0]) if stage.planar else _aside(up)
    return centre + _away(seen - centre, aside, up) * aside, centre, up


def _away(points: Array, aside: Array, up: Array) -> float:
    """How far along ``aside`` from the origin the eye must be to see all the points."""
    right = np.cross(up, aside)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(aside, right)])
    return float(np.max(points @ aside + (2.0 * np.abs(points @ axes.T) / SEEN).max(axis=1)))


def _aside(up: Array) -> Array:
    """A unit vector to look from, with `ASIDE` meant for +z up."""
    x, y, z = ASIDE
    ahead = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    ahead -= up * float(ahead @ up)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(up, ahead)
    return np.asarray((x * ahead + y * right + z * up) / math.hypot(x, y, z))
