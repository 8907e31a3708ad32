"""Telemetry of a node as messages of ROS 2 (SI units, CDR): joint states, pressures, tips, /tf, faults.

Types, their hashes and their serialization are those of `rosbags` for ROS 2 Jazzy.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from contid.errors import ContidError, require_extra
from contid.remote.client.described_robot import unit_of
from contid.remote.protocol.wire import Fields
from contid.robot_file.base import Quantity
from contid.units import mm_to_m
from contid_fleet.ros.keys import ros_name

JOINT_STATE: Final = "sensor_msgs/msg/JointState"
PRESSURE: Final = "sensor_msgs/msg/FluidPressure"
POINT: Final = "geometry_msgs/msg/PointStamped"
TRANSFORM: Final = "tf2_msgs/msg/TFMessage"
DIAGNOSTICS: Final = "diagnostic_msgs/msg/DiagnosticArray"
#: Frame of every tip.
WORLD: Final = "world"
#: Levels of diagnostic_msgs/DiagnosticStatus.
OK, WARN, ERROR = 0, 1, 2


@dataclass(frozen=True, slots=True)
class RosMessage:
    """A message: its topic, type, and CDR bytes."""

    topic: str
    type_name: str
    payload: bytes


@cache
def type_store() -> Any:
    """The types of ROS 2 Jazzy.

    Raises:
        MissingExtraError: rosbags is not installed.
    """
    require_extra("messages of ROS 2", "rosbags")
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def type_hash(type_name: str) -> str:
    """``RIHS01_`` and 64 digits (REP 2011)."""
    return str(type_store().hash_rihs01(type_name))


def _new(type_name: str, **fields: Any) -> Any:
    """An object of a ROS 2 type."""
    return type_store().types[type_name](**fields)


class NodeMessages:
    """Makes messages of the telemetry of one node.

    Args:
        node: its name.
        described: its response to `describe`.

    Raises:
        ContidError: two names are equal in ROS 2.
    """

    def __init__(self, node: str, described: Fields) -> None:
        self._base = f"/contid/{ros_name(node)}"
        self._node = node
        self._robots: Mapping[str, Fields] = described["robots"]
        for names in (self._robots, *(robot["axes"] for robot in self._robots.values())):
            if len({ros_name(name) for name in names}) < len(names):
                raise ContidError(f"{node}: two of {', '.join(names)} are the same name in ROS 2")

    def describes(self, frame: Fields) -> bool:
        """False when the frame has robots that `describe` did not have."""
        return {*frame["robots"]} <= {*self._robots}

    def messages(self, frame: Fields, time_ns: int) -> Iterator[RosMessage]:
        """The messages of one frame of telemetry.

        Args:
            frame: telemetry with the fields that telemetry has by default.
            time_ns: time of day of its tick.
        """
        transforms = []
        statuses = []
        for name, fields in frame["robots"].items():
            described = self._robots[name]
            yield from self._axes(name, described, fields, time_ns)
            if fields.get("tip_mm") is not None:
                tip_m = [mm_to_m(value) for value in fields["tip_mm"]]
                point = _new("geometry_msgs/msg/Point", x=tip_m[0], y=tip_m[1], z=tip_m[2])
                stamped = _new(POINT, header=_header(WORLD, time_ns), point=point)
                yield _message(f"{self._base}/{ros_name(name)}/tip", POINT, stamped)
                transforms.append(self._transform(name, tip_m, time_ns))
            statuses.append(self._status(name, fields))
        if transforms:
            yield _message("/tf", TRANSFORM, _new(TRANSFORM, transforms=transforms))
        array = _new(DIAGNOSTICS, header=_header("", time_ns), status=statuses)
        yield _message("/diagnostics", DIAGNOSTICS, array)

    def _axes(self, robot: str, described: Fields, fields: Fields, time_ns: int) -> Iterator[RosMessage]:
        """Joint states of lengths and angles, a message per pressure (no joint); none before a sample.

        Extra axes may have another unit than those of the model.
        """
        import numpy as np

        measured = fields.get("measured")
        if measured is None:
            return
        base = f"{self._base}/{ros_name(robot)}"
        joints: dict[str, float] = {}
        for (axis, limits), value in zip(described["axes"].items(), measured, strict=True):
            name, unit = f"{ros_name(robot)}_{ros_name(axis)}", unit_of(limits)
            if unit == Quantity.PRESSURE.unit:
                header, pascal = _header(name, time_ns), Quantity.PRESSURE.to_si(float(value))
                pressure = _new(PRESSURE, header=header, fluid_pressure=pascal, variance=0.0)
                yield _message(f"{base}/{ros_name(axis)}/pressure", PRESSURE, pressure)
            else:
                quantity = Quantity.ANGLE if unit == Quantity.ANGLE.unit else Quantity.LENGTH
                joints[name] = quantity.to_si(float(value))
        if joints:
            none, position = np.zeros(0), np.array([*joints.values()], dtype=np.float64)
            state = _new(
                JOINT_STATE,
                header=_header("", time_ns),
                name=[*joints],
                position=position,
                velocity=none,
                effort=none,
            )
            yield _message(f"{base}/joint_states", JOINT_STATE, state)

    def _transform(self, robot: str, tip_m: Sequence[float], time_ns: int) -> Any:
        """Transform from the world to the tip; telemetry has no orientation, so the rotation is identity."""
        translation = _new("geometry_msgs/msg/Vector3", x=tip_m[0], y=tip_m[1], z=tip_m[2])
        rotation = _new("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        return _new(
            "geometry_msgs/msg/TransformStamped",
            header=_header(WORLD, time_ns),
            child_frame_id=f"{ros_name(self._node)}_{ros_name(robot)}_tip",
            transform=_new("geometry_msgs/msg/Transform", translation=translation, rotation=rotation),
        )

    def _status(self, robot: str, fields: Fields) -> Any:
        fault, state = int(fields.get("fault") or 0), str(fields["state"])
        level = ERROR if fault else WARN if state == "OFF" else OK
        message = f"{state}, fault {fault}" if fault else state
        values = [
            _new("diagnostic_msgs/msg/KeyValue", key=key, value=value)
            for key, value in (("state", state), ("fault", str(fault)))
        ]
        return _new(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=level,
            name=f"{self._node}: {robot}",
            message=message,
            hardware_id=self._node,
            values=values,
        )


def _header(frame: str, time_ns: int) -> Any:
    stamp = _new("builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)
    return _new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def _message(topic: str, type_name: str, made: Any) -> RosMessage:
    return RosMessage(topic, type_name, bytes(type_store().serialize_cdr(made, type_name)))
