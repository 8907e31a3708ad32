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
from contid.view.scene import Scene

#: Seconds of trail behind a tip, and of a plot while the robot runs.
TRAIL_S: Final = 5.0
WINDOW_S: Final = 20.0
#: Side views come from here: ahead of the robot, to its right, somewhat above.
ASIDE: Final = (0.8, -1.0, 0.35)
#: What the eye sees at a distance of 1, upwards and sideways, less a margin.
SEEN: Final = np.array([1.2, 0.9])
#: More plots than this go behind tabs.
STACKED: Final = 2
#: The names of more curves than this would hide them; the pointer tells them too.
LEGEND: Final = 3


def build_layout(scenes: Sequence[Scene], live: bool) -> rrb.Blueprint:
    """The layout.

    Args:
        scenes: the robots.
        live: plots show the last seconds, not all.
    """
    ranges = [_last(WINDOW_S)] if live else None
    names = [scene.plan.name for scene in scenes]
    actuation = [_actuation(scene, ranges) for scene in scenes]
    plots: list[Any] = actuation if len(actuation) <= STACKED else [rrb.Tabs(*actuation)]
    bars = [_bars(scene) for scene in scenes if not scene.planar]
    error = rrb.TimeSeriesView(
        name="tip error [mm]",
        contents=_contents(paths.plot(name, "tip_error") for name in names),
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
            rrb.Vertical(_space(scenes), events, row_shares=[4, 1]),
            rrb.Vertical(*plots, rrb.Tabs(timing, error), *bars),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(state="collapsed", timeline=paths.TIME, play_state="following"),
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


def _actuation(scene: Scene, ranges: Any) -> rrb.TimeSeriesView:
    plan = scene.plan
    entities = [paths.plot(plan.name, what) for what in ("command", "measured")]
    name = f"{plan.name}: {plan.quantity}s [{plan.quantity.unit}]"
    return rrb.TimeSeriesView(
        name=name,
        contents=_contents(entities),
        plot_legend=rrb.PlotLegend(visible=len(plan.axis_names) <= LEGEND),
        time_ranges=ranges,
    )


def _bars(scene: Scene) -> rrb.BarChartView:
    name = scene.plan.name
    return rrb.BarChartView(name=f"{name}: range in use [%]", contents=_contents([paths.plot(name, "range")]))


def _space(scenes: Sequence[Scene]) -> rrb.Spatial3DView:
    entities, trails = [], {}
    for scene in scenes:
        parts = ["base", "backbone", "measured", "tracked", "tracked_tip", "frames", "target", "trail"]
        parts += ["reach"] if scene.outline is not None else []
        entities += [paths.body(scene.plan.name, part) for part in parts]
        behind = rrb.VisibleTimeRanges([_last(TRAIL_S)])
        trails[paths.body(scene.plan.name, "trail")] = [rr.Points3D.from_fields().visualizer(), behind]
    flat = all(scene.planar for scene in scenes)
    corners = np.vstack([scene.corners for scene in scenes])
    low, high = corners.min(axis=0), corners.max(axis=0)
    centre, size = 0.5 * (low + high), high - low
    up = np.array([0.0, 1.0, 0.0] if flat else scenes[0].up)
    aside = np.array([0.0, 0.0, 1.0]) if flat else _aside(up)
    away = float(np.max(size[:2] / SEEN) if flat else np.linalg.norm(size))
    return rrb.Spatial3DView(
        name=f"{', '.join(scene.plan.name for scene in scenes)} [mm]",
        origin="/",
        contents=_contents(entities),
        overrides=trails,
        background=rrb.Background(color=(22, 24, 27)),
        line_grid=rrb.LineGrid3D(spacing=10.0, plane=rr.components.Plane3D((0.0, 0.0, 1.0), 0.0)),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=centre + away * aside,
            look_target=centre,
            eye_up=up,
        ),
    )


def _aside(up: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """A unit vector to look from, with `ASIDE` meant for +z up."""
    x, y, z = ASIDE
    ahead = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    ahead -= up * float(ahead @ up)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(up, ahead)
    return np.asarray((x * ahead + y * right + z * up) / math.hypot(x, y, z))
