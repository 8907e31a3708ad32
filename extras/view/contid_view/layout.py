"""The layout of the viewer (Rerun's blueprint) for the robots of one file.

Planar robots are seen from above, others from the side. Every view names its entities, so that a test can
compare them with a recording.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from contid.kinematics.array import Array
from contid.kinematics.model import Compliant
from contid_view import paths
from contid_view.rerun.bars import LEFT, RIGHT, ROW, WIDTH, BarRows, bar_rows
from contid_view.robot_scene import RobotScene
from contid_view.scene import Scene

#: Length of the trail behind a tip, and of a plot while the robot runs.
TRAIL_S: Final = 5.0
WINDOW_S: Final = 20.0
#: Direction from the robot to the camera in side views: ahead, to its right (-y), above.
VIEW_FROM: Final = (0.8, -1.0, 0.35)
#: Width and height that the camera sees at a distance of 1, less a margin.
FIELD_OF_VIEW: Final = np.array([1.35, 0.97])
BACKGROUND: Final = rrb.Background(color=(22, 24, 27))
#: More plots than this are put on tabs.
MAX_STACKED: Final = 2
#: A legend would cover curves; the bars have the names of the axes in the same colours.
NO_LEGEND: Final = rrb.PlotLegend(visible=False)
#: More axes than this have a tab per robot.
MAX_BARS: Final = 18


def build_layout(scene: Scene, live: bool, finished: bool) -> rrb.Blueprint:
    """The layout.

    Args:
        scene: what there is to draw.
        live: drawn while the robots run: plots show the last seconds and the lateness of the ticks.
        finished: shown when the run is over: it plays from its beginning.
    """
    ranges = [_last(WINDOW_S)] if live else None
    errors = [
        paths.plot(robot.config.name, what)
        for robot in scene.robots
        for what in ("tip_error", "tip_error_measured")
    ]
    actuation = [_actuation(robot, ranges) for robot in scene.robots]
    plots: list[Any] = actuation if len(actuation) <= MAX_STACKED else [rrb.Tabs(*actuation)]
    error = rrb.TimeSeriesView(
        name="tip off target [mm], measured grey",
        contents=_contents(errors),
        plot_legend=NO_LEGEND,
        time_ranges=ranges,
    )
    timing = rrb.TimeSeriesView(
        name="lateness, work [us]",
        contents=_contents([paths.TIMING]),
        plot_legend=NO_LEGEND,
        time_ranges=ranges,
    )
    events = rrb.TextLogView(
        name="events",
        contents=_contents([paths.EVENTS]),
        columns=rrb.TextLogColumns(
            text_log_columns=["LogLevel", "Body"],
            # Their width cannot be set: the time is in the text.
            timeline_columns=[
                rrb.encodings.TimelineColumn(line, visible=False) for line in (paths.TIME, paths.TICK)
            ],
        ),
    )
    banner = rrb.TextDocumentView(name="state", contents=_contents([paths.BANNER]), titlebar=False)
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(banner, _space(scene), events, row_shares=[0.4, 4, 1.2]),
            rrb.Vertical(*plots, rrb.Tabs(timing, error, active_tab=0 if live else 1), _bars(scene)),
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


def _contents(entities: Iterable[str]) -> list[str]:
    return [f"+ /{entity}" for entity in entities]


def _last(seconds: float) -> rrb.VisibleTimeRange:
    return rrb.VisibleTimeRange(
        paths.TIME,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-seconds),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )


def _actuation(robot: RobotScene, ranges: Any) -> rrb.TimeSeriesView | rrb.Tabs:
    config = robot.config
    views = []
    for group, axes in robot.groups.items():
        names = config.axis_names[axes]
        what = ", ".join(names) if group else f"{config.quantity}s"
        view = rrb.TimeSeriesView(
            name=f"{config.name}: {what} [{config.quantities[axes.start].unit}]",
            contents=_contents(paths.plot(config.name, group + curve) for curve in ("command", "measured")),
            plot_legend=NO_LEGEND,
            time_ranges=ranges,
        )
        views.append(view)
    return views[0] if len(views) == 1 else rrb.Tabs(*views, active_tab=0)


def _bars(scene: Scene) -> rrb.Spatial2DView | rrb.Tabs:
    """Bars of all robots in one view, or on a tab per robot."""
    rows = bar_rows(scene.robots)
    if sum(each.count for each in rows) <= MAX_BARS:
        return _bar_view("axes in their ranges", rows)
    return rrb.Tabs(*(_bar_view(f"{each.robot.config.name}: axes", [each]) for each in rows), active_tab=0)


def _bar_view(name: str, rows: Sequence[BarRows]) -> rrb.Spatial2DView:
    parts = ("range_tracks", "range", "range_names")
    entities = [paths.plot(each.robot.config.name, part) for each in rows for part in parts]
    top, bottom = rows[0].first * ROW, (rows[-1].first + rows[-1].count) * ROW
    return rrb.Spatial2DView(
        name=name,
        contents=_contents(entities),
        background=BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=[-LEFT, WIDTH + RIGHT], y_range=[top, bottom]),
    )


def _space(scene: Scene) -> rrb.Spatial3DView:
    entities, trails = [paths.FLOOR], {}
    for robot in scene.robots:
        parts = [*paths.PARTS]
        parts += ["reach"] if robot.outline is not None else []
        parts += ["compliance"] if isinstance(robot.config.model, Compliant) else []
        parts += ["load"] if robot.config.sensing is not None else []
        entities += [paths.body(robot.config.name, part) for part in parts]
        behind = rrb.VisibleTimeRanges([_last(TRAIL_S)])
        trails[paths.body(robot.config.name, "trail")] = [rr.Points3D.from_fields().visualizer(), behind]
    entities += [paths.body(rope.name, "rope") for rope in scene.ropes]
    entities += [paths.obstacle(name) for name in scene.obstacles]
    position, look_target, up = camera(scene)
    return rrb.Spatial3DView(
        name=f"{', '.join(robot.config.name for robot in scene.robots)}: grid of {scene.cell_mm:g} mm",
        origin="/",
        contents=_contents(entities),
        overrides=trails,
        background=BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=False),  # it is infinite: its far lines merge into a surface
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=position, look_target=look_target, eye_up=up
        ),
    )


def camera(scene: Scene) -> tuple[Array, Array, Array]:
    """Position, point looked at [mm] and up direction of a camera that sees the whole workspace."""
    workspace = scene.workspace()
    centre = 0.5 * (workspace.min(axis=0) + workspace.max(axis=0))
    up = np.array([0.0, 1.0, 0.0] if scene.planar else scene.robots[0].up)
    view_from = np.array([0.0, 0.0, 1.0]) if scene.planar else _view_from(up)
    return centre + _distance(workspace - centre, view_from, up) * view_from, centre, up


def _distance(points: Array, view_from: Array, up: Array) -> float:
    """Distance from the origin along ``view_from`` at which the camera sees all the points."""
    right = np.cross(up, view_from)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(view_from, right)])
    return float(np.max(points @ view_from + (2.0 * np.abs(points @ axes.T) / FIELD_OF_VIEW).max(axis=1)))


def _view_from(up: Array) -> Array:
    """Unit vector of `VIEW_FROM`, which is given for +z up."""
    x, y, z = VIEW_FROM
    ahead = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    ahead -= up * float(ahead @ up)
    ahead /= np.linalg.norm(ahead)
    left = np.cross(up, ahead)
    return np.asarray((x * ahead + y * left + z * up) / math.hypot(x, y, z))
