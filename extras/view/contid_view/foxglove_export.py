"""A session as an MCAP file with the message types of Foxglove: its 3D panel shows the robots as they are.

``/scene`` has bodies, targets and ropes in the frame ``world``, ``/tf`` the frames of base and tip of every
robot, ``/joint_states`` the measured axes (``ROBOT/AXIS``, in m, Pa or rad), ``/log`` the events.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import BinaryIO, Final

import foxglove
import numpy as np
from foxglove import messages as fox
from foxglove.channels import FrameTransformsChannel, JointStatesChannel, LogChannel, SceneUpdateChannel

from contid.control.engine.events import RunEvent
from contid.control.engine.tick_layout import RecordLayout, RobotRecord, TickRecord
from contid.kinematics.array import Array
from contid.robot_file.load import LoadedFile
from contid.targets import Actuation, load_or_zero
from contid.units import MM_PER_M
from contid_sessions.kept_error import KeptError
from contid_view.body import SolidBody, quaternion_of
from contid_view.colours import PLATE, ROPE, TARGET, Colour, of_robot
from contid_view.event_line import event_line
from contid_view.frames import FRAMES_HZ
from contid_view.robot_scene import RobotDrawing, RobotScene
from contid_view.scene import Scene, build_scene, rope_line

WORLD: Final = "world"
#: Thickness of tendons and of the commanded line, and the size of a target, as fractions of the length.
THIN, TARGET_SIZE = 0.008, 0.04
COMMANDED: Final[Colour] = (230, 230, 230)
#: Time of day [ns], and the values of a record or an event.
TimedEntry = tuple[int, Sequence[float] | None, RunEvent | None]


def write_foxglove(
    file: BinaryIO, entries: Iterable[TimedEntry], loaded: LoadedFile, layout: RecordLayout
) -> None:
    """Write a whole run.

    Args:
        file: a new file, from its beginning.
        entries: ticks and events in their order.
        loaded: the robot file of the run.
        layout: layout of the records.

    Raises:
        OSError: the file cannot be written, as on a full disk.
    """
    context = foxglove.Context()
    kept = KeptError(file)
    with foxglove.open_mcap(kept, context=context):
        writer = _Writer(context, build_scene(loaded, layout.rate_hz))
        shown = -1
        for time_ns, values, event in entries:
            if kept.error is not None:
                break
            if event is not None:
                writer.event(time_ns, event)
            elif values is not None:
                record = layout.decode(tuple(values))
                writer.axes(time_ns, record)
                frame = int(record.tick * FRAMES_HZ / layout.rate_hz)
                if frame != shown:
                    shown = frame
                    writer.scene(time_ns, record)
    if kept.error is not None:
        raise kept.error


class _Writer:
    """The channels of one file."""

    def __init__(self, context: foxglove.Context, scene: Scene) -> None:
        self._scene = scene
        self._updates = SceneUpdateChannel("/scene", context=context)
        self._transforms = FrameTransformsChannel("/tf", context=context)
        self._joints = JointStatesChannel("/joint_states", context=context)
        self._log = LogChannel("/log", context=context)

    def event(self, time_ns: int, event: RunEvent) -> None:
        """An event as a line of the log, unless it is for programs only."""
        if (line := event_line(event)) is None:
            return
        level = {
            "WARN": fox.LogLevel.Warning, "ERROR": fox.LogLevel.Error, "CRITICAL": fox.LogLevel.Fatal
        }.get(line[0], fox.LogLevel.Info)  # fmt: skip
        message = fox.Log(timestamp=_stamp(time_ns), level=level, message=line[1], name="contid")
        self._log.log(message, log_time=time_ns)

    def axes(self, time_ns: int, record: TickRecord) -> None:
        """Measured axes of all robots; an axis without a value is left out."""
        joints = [
            fox.JointState(name=f"{robot.config.name}/{axis}", position=value)
            for robot, each in zip(self._scene.robots, record.robots, strict=True)
            for axis, value in zip(robot.config.axis_names, _measured(robot, each), strict=True)
            if math.isfinite(value)
        ]
        self._joints.log(fox.JointStates(timestamp=_stamp(time_ns), joints=joints), log_time=time_ns)

    def scene(self, time_ns: int, record: TickRecord) -> None:
        """Bodies, targets, ropes and frames of one instant."""
        stamp = _stamp(time_ns)
        entities, frames = [], []
        drawings: dict[str, RobotDrawing | None] = {}
        for number, (robot, each) in enumerate(zip(self._scene.robots, record.robots, strict=True)):
            load = load_or_zero(each.load_n)
            sampled, command = _measured(robot, each), tuple(axis.command for axis in each.axes)
            measured, commanded = robot.drawing(sampled, load), robot.drawing(command, load)
            body = measured or commanded
            drawings[robot.config.name] = body
            frames.append(_transform(stamp, robot.config.name, robot.base))
            if body is not None:
                frames.append(_transform(stamp, f"{robot.config.name}/tip", body.frames[-1]))
            lines = _outside(robot, body)
            if commanded is not None and measured is not None:
                lines += [
                    _line(part, COMMANDED, THIN * robot.length_mm)
                    for part in commanded.strips[: commanded.sections]
                ]
            entities.append(
                fox.SceneEntity(
                    timestamp=stamp,
                    frame_id=WORLD,
                    id=robot.config.name,
                    lines=lines,
                    cylinders=_body(self._scene.bodies[number], body, number),
                    spheres=_target(robot, each),
                )
            )
        for rope in self._scene.ropes:
            line, thick_mm = rope_line(rope, drawings), THIN * self._scene.robots[0].length_mm
            lines = [] if line is None else [_line(line, ROPE, thick_mm)]
            entities.append(fox.SceneEntity(timestamp=stamp, frame_id=WORLD, id=rope.name, lines=lines))
        self._updates.log(fox.SceneUpdate(entities=entities), log_time=time_ns)
        self._transforms.log(fox.FrameTransforms(transforms=frames), log_time=time_ns)


def _measured(robot: RobotScene, record: RobotRecord) -> Actuation:
    """The measured actuation [m or Pa]; NaN where a device has no value."""
    return robot.config.transmission.to_actuation(tuple(axis.value for axis in record.axes))


def _outside(robot: RobotScene, drawing: RobotDrawing | None) -> list[fox.LinePrimitive]:
    """Tendons; the edges of a finger are in its body."""
    if drawing is None or robot.planar:
        return []
    return [_line(part, COMMANDED, THIN * robot.length_mm) for part in drawing.strips[drawing.sections :]]


def _body(body: SolidBody, drawing: RobotDrawing | None, number: int) -> list[fox.CylinderPrimitive]:
    """The solid body, as in the viewer."""
    if drawing is None:
        return []
    placed = body.place([drawing])
    inks = [_ink(colour) for colour in (*of_robot(number), PLATE)]
    centres = (placed.centres[0] / MM_PER_M).tolist()
    lengths, radii = (placed.lengths[0] / MM_PER_M).tolist(), (body.radii / MM_PER_M).tolist()
    found = []
    for (x, y, z), (i, j, k, w), length, radius, shade in zip(
        centres, placed.quaternions[0].tolist(), lengths, radii, body.shades.tolist(), strict=True
    ):
        pose = fox.Pose(position=fox.Vector3(x=x, y=y, z=z), orientation=fox.Quaternion(x=i, y=j, z=k, w=w))
        size = fox.Vector3(x=2.0 * radius, y=2.0 * radius, z=length)
        found.append(
            fox.CylinderPrimitive(pose=pose, size=size, bottom_scale=1.0, top_scale=1.0, color=inks[shade])
        )
    return found


def _target(robot: RobotScene, record: RobotRecord) -> list[fox.SpherePrimitive]:
    if not all(map(math.isfinite, record.tip_m)):
        return []
    x, y, z = record.tip_m
    edge = TARGET_SIZE * robot.length_mm / MM_PER_M
    pose = fox.Pose(position=fox.Vector3(x=x, y=y, z=z), orientation=fox.Quaternion(w=1.0))
    return [fox.SpherePrimitive(pose=pose, size=fox.Vector3(x=edge, y=edge, z=edge), color=_ink(TARGET))]


def _line(points_mm: Array, colour: Colour, thickness_mm: float) -> fox.LinePrimitive:
    return fox.LinePrimitive(
        type=fox.LinePrimitiveLineType.LineStrip,
        pose=fox.Pose(position=fox.Vector3(), orientation=fox.Quaternion(w=1.0)),
        thickness=thickness_mm / MM_PER_M,
        points=[fox.Point3(x=x, y=y, z=z) for x, y, z in (points_mm / MM_PER_M).tolist()],
        color=_ink(colour),
    )


def _transform(stamp: fox.Timestamp, name: str, frame: Array) -> fox.FrameTransform:
    """A frame of a drawing, (4, 3): its origin [mm] and axes as rows."""
    x, y, z = (frame[0] / MM_PER_M).tolist()
    i, j, k, w = quaternion(frame)
    return fox.FrameTransform(
        timestamp=stamp,
        parent_frame_id=WORLD,
        child_frame_id=name,
        translation=fox.Vector3(x=x, y=y, z=z),
        rotation=fox.Quaternion(x=i, y=j, z=k, w=w),
    )


def quaternion(frame: Array) -> tuple[float, float, float, float]:
    """The unit quaternion (x, y, z, w) of a frame of a drawing, (4, 3).

    A mirrored robot has a left-handed frame, which no rotation gives: its z points the other way here.
    """
    x, y = frame[1], frame[2]
    i, j, k, w = quaternion_of(np.column_stack([x, y, np.cross(x, y)]))
    return i, j, k, w


def _stamp(time_ns: int) -> fox.Timestamp:
    return fox.Timestamp(sec=time_ns // 1_000_000_000, nsec=time_ns % 1_000_000_000)


def _ink(colour: Colour) -> fox.Color:
    r, g, b = (part / 255 for part in colour)
    return fox.Color(r=r, g=g, b=b, a=1.0)
