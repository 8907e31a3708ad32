"""The modes of robots in a Rerun recording: bodies side by side, each swinging at its own frequency."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from contid.kinematics.array import Array
from contid.robot_file.load import LoadedFile
from contid_view import colours, paths
from contid_view.body import SolidBody
from contid_view.layout import BACKGROUND, camera
from contid_view.rerun.bodies import RerunBody
from contid_view.rerun.stream import RerunStream
from contid_view.robot_scene import POINTS, RobotDrawing, RobotScene
from contid_view.scene import Scene, build_scene
from contid_view.view_target import ViewError

if TYPE_CHECKING:
    from contid_dynamics.swing import SwingingPose

#: Frames of a period of the fastest mode, and the least and greatest number of frames a second. A mode of
#: more than half of that cannot be seen as fast as it is; its label has its frequency.
_PER_PERIOD: Final = 12.0
_RATE_HZ: Final = (30.0, 120.0)
#: Periods of the slowest mode, and the least and greatest duration of a drawing [s].
_PERIODS: Final = 3.0
_PLAYS_S: Final = (3.0, 12.0)
#: From robot to robot, as a share of the length of the longest.
_APART: Final = 0.8


def draw_swings(loaded: LoadedFile, swinging: Mapping[str, SwingingPose], path: Path) -> None:
    """Draw the modes of robots into a file that `contid view` shows.

    Args:
        loaded: the robot file.
        swinging: its robots with a moving body, by name.
        path: of the recording.

    Raises:
        ViewError: the file cannot be written.
    """
    frequencies = [mode.frequency_hz for each in swinging.values() for mode in each.modes.modes]
    moving = [each for each in frequencies if each > 0.0] or [1.0]
    rate_hz = float(np.clip(_PER_PERIOD * max(moving), *_RATE_HZ))
    frames = round(rate_hz * float(np.clip(_PERIODS / min(moving), *_PLAYS_S)))
    scene = build_scene(loaded, rate_hz)
    recording = rr.RecordingStream(f"contid modes of {loaded.file.name}")
    drawing = _Drawing(scene, swinging, RerunStream(recording, rate_hz))
    try:
        recording.save(path, default_blueprint=drawing.layout())
        rr.set_log_time_enabled(False, recording=recording)
        rr.set_log_tick_enabled(False, recording=recording)
        drawing.write(frames)
        recording.flush(timeout_sec=20.0)
    except Exception as error:  # rerun's own classes
        raise ViewError(f"{path}: cannot write it: {error}") from error
    finally:
        recording.disconnect()


class _Drawing:
    """All modes of all robots, in a row across the view."""

    def __init__(self, scene: Scene, swinging: Mapping[str, SwingingPose], stream: RerunStream) -> None:
        self._stream, self._swinging = stream, swinging
        self._robots = {robot.config.name: robot for robot in scene.robots if robot.config.name in swinging}
        self._bodies = dict(zip([robot.config.name for robot in scene.robots], scene.bodies, strict=True))
        position, target, self._up = camera(scene)
        self._towards = (position - target) / np.linalg.norm(position - target)
        right = np.cross(self._up, self._towards)
        longest = max(robot.length_mm for robot in self._robots.values())
        self._step = _APART * longest * right / np.linalg.norm(right)
        self._places = [(name, k) for name, each in swinging.items() for k in range(len(each.modes.modes))]
        self._length_mm = longest

    def write(self, frames: int) -> None:
        """Every body through a number of frames, and the path of its tip."""
        times_s = np.arange(frames) / self._stream.rate_hz
        for number, (name, k) in enumerate(self._places):
            mode = self._swinging[name].modes.modes[k]
            entity = f"{name}/mode_{k + 1}"
            shares = np.sin(2.0 * math.pi * mode.frequency_hz * times_s)
            lines = [self._line(number, share) for share in shares]
            body: SolidBody = self._bodies[name]
            drawings = [RobotDrawing((), [line], [], 1) for line in lines]
            RerunBody(self._stream, entity, body, colours.of_robot(number)).write(range(frames), drawings)
            tips = np.array([self._line(number, share)[-1] for share in np.linspace(-1.0, 1.0, 17)])
            still = rr.LineStrips3D(
                [self._line(number, 0.0), tips],
                colors=[colours.MEASURED, colours.TRAIL],
                radii=rr.Radius.ui_points([1.0, 1.5]),
            )
            self._stream.static(paths.body(entity, "rest"), still)
            label = rr.Points3D(
                [self._line(number, 0.0)[0] - 0.12 * self._length_mm * self._up],
                labels=[f"{name} {k + 1}: {mode.frequency_hz:.2f} Hz"],
                colors=colours.TEXT,
                radii=rr.Radius.ui_points(0.5),
                show_labels=True,
            )
            self._stream.static(paths.body(entity, "label"), label)

    def layout(self) -> rrb.Blueprint:
        """One view of all, which plays again and again."""
        lines = [
            self._line(number, share) for number in range(len(self._places)) for share in (-1.0, 0.0, 1.0)
        ]
        points = np.vstack(lines)
        centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
        wide = max(float(np.ptp(points @ (self._step / np.linalg.norm(self._step)))), 2.0 * self._length_mm)
        eye = rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=centre + 1.1 * wide * self._towards,
            look_target=centre,
            eye_up=self._up,
        )
        return rrb.Blueprint(
            rrb.Spatial3DView(
                name="modes: small motions, drawn large",
                origin="/",
                background=BACKGROUND,
                line_grid=rrb.LineGrid3D(visible=False),
                eye_controls=eye,
            ),
            rrb.TimePanel(state="collapsed", timeline=paths.TIME, play_state="playing", loop_mode="all"),
            rrb.BlueprintPanel(state="hidden"),
            rrb.SelectionPanel(state="hidden"),
        )

    def _line(self, number: int, share: float) -> Array:
        """The backbone in the world [mm], points at equal distances; each mode at its place in the row."""
        name, k = self._places[number]
        robot: RobotScene = self._robots[name]
        line = robot.in_world_mm(self._swinging[name].line_m(k, share))
        at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        even = np.linspace(0.0, at[-1], POINTS)
        spaced = np.stack([np.interp(even, at, line[:, axis]) for axis in range(3)], axis=1)
        return np.asarray(spaced + number * self._step)
