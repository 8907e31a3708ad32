"""The record of one tick: every value declared once, with its place, its channel and its meaning.

`TickRecord`, `RobotRecord` and `AxisRecord` are the declaration. From it derive the slot of the ring, the
packer, the decoder, the channels and schemas of a session file and what a replay compares.

A record is a flat sequence: the values of the tick, then per robot its values, then those of its axes.
``int`` is stored as uint64, ``float`` as float64, `Vec3` as three float64; absent is NaN. The ring carries
its `RecordLayout` as JSON, so a reader needs neither the robot file nor a model.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from operator import itemgetter
from typing import Annotated, Any, Final, NamedTuple, get_args, get_type_hints

from contid.control.tick.supervisor import Mode
from contid.targets import Vec3

# Bits of RobotRecord.flags.
HAS_TARGET: Final = 1
CONVERGED: Final = 2
ENABLED: Final = 4
UNRESTED: Final = 8


@dataclass(frozen=True, slots=True)
class About:
    """What is declared about a value beside its name and type.

    Attributes:
        channel: of the session file that carries it.
        meaning: for the schema.
        path: its keys in a message of that channel, ``/`` between them; "" for its name. ``{axis}``,
            ``{unit}`` and ``{device}`` stand for the axis, the unit of its actuation and that of its device.
        json: its JSON type; "" for that of its Python type.
        compared: its name in a replay that compares it; "" when it only describes.
    """

    channel: str
    meaning: str
    path: str = ""
    json: str = ""
    compared: str = ""


class AxisRecord(NamedTuple):
    """One axis at one tick; actuation in [m or Pa], device values in [rad or Pa]."""

    target: Annotated[
        float, About("target", "actuation the target asks for", "{axis}_{unit}", compared="target")
    ]
    solution: Annotated[
        float, About("solution", "actuation of the model's solution", "{axis}_{unit}", compared="solution")
    ]
    command: Annotated[
        float, About("command", "actuation commanded after the limits", "{axis}_{unit}", compared="command")
    ]
    device: Annotated[
        float, About("command", "value sent to the device", "device/{axis}_{device}", compared="device")
    ]
    limits: Annotated[
        float,
        About("command", "bits: 1 position, 2 velocity, 4 acceleration, 8 refused, 16 tension",
              "limits/{axis}", "integer", "limits"),
    ]  # fmt: skip
    value: Annotated[float, About("sample", "value the device reported", "{axis}/value_{device}")]
    time_s: Annotated[
        float, About("sample", "when it was measured, on the clock of deadline_s", "{axis}/time_s")
    ]
    valid: Annotated[float, About("sample", "the newest exchange read it", "{axis}/valid", "boolean")]
    age_s: Annotated[float, About("sample", "its age at the end of that exchange", "{axis}/age_s")]
    velocity: Annotated[float, About("sample", "velocity the device reported", "{axis}/velocity_{device}_s")]
    effort: Annotated[
        float, About("sample", "current [A] of servos and motors, duty of regulators", "{axis}/effort")
    ]
    temperature_c: Annotated[float, About("sample", "temperature of the device", "{axis}/temperature_c")]
    voltage_v: Annotated[float, About("sample", "supply of the device", "{axis}/voltage_v")]
    tension_n: Annotated[float, About("sample", "tension at the load cell", "{axis}/tension_n")]


class RobotRecord(NamedTuple):
    """One robot at one tick; positions [m] and directions in the world frame."""

    mode: Annotated[
        int, About("tick", ", ".join(f"{mode.value} {mode.name}" for mode in Mode), compared="mode")
    ]
    fault: Annotated[
        int, About("tick", "0 none; `contid fault NUMBER` explains the others", compared="fault")
    ]
    flags: Annotated[
        int, About("tick", "bits: 1 has a target, 2 converged, 4 devices enabled, 8 not yet at rest as asked")
    ]
    limited_by: Annotated[int, About("solution", "bits; events 'limit_name' give their names")]
    iterations: Annotated[int, About("solution", "steps of the solver")]
    tip_m: Annotated[Vec3, About("target", "tip position in the world frame", compared="target")]
    direction: Annotated[
        Vec3, About("target", "unit tangent at the tip in the world frame", compared="target direction")
    ]
    mid_m: Annotated[Vec3, About("target", "mid-point in the world frame", compared="target mid-point")]
    load_n: Annotated[
        Vec3, About("target", "known force on the tip in the world frame", compared="target load")
    ]
    residual_m: Annotated[
        float, About("solution", "distance between the model's tip at the solution and the target")
    ]
    tip_error_m: Annotated[
        float, About("command", "distance between the model's tip at the command and the target")
    ]
    measured_tip_m: Annotated[
        Vec3, About("sample", "tip position a tracker measured within the last second, world frame")
    ]
    measured_direction: Annotated[Vec3, About("sample", "unit tangent it measured there, world frame")]
    measured_age_s: Annotated[float, About("sample", "time since that capture")]
    x_axis: Annotated[
        Vec3, About("target", "x axis of the tip's frame in the world frame", compared="target x axis")
    ]
    estimated_load_n: Annotated[
        Vec3,
        About("sample", "force on the tip by its measurements, world frame", compared="estimated load"),
    ]
    estimated_sigma_n: Annotated[Vec3, About("sample", "standard deviation of its components, world frame")]
    axes: tuple[AxisRecord, ...]


class TickRecord(NamedTuple):
    """One tick of the whole robot file; missing tick numbers were skipped."""

    tick: Annotated[int, About("tick", "number of the tick")]
    skipped: Annotated[int, About("tick", "ticks skipped so far")]
    deadline_s: Annotated[
        float, About("tick", "when it should have started, on CLOCK_MONOTONIC or in virtual time")
    ]
    lateness_s: Annotated[float, About("tick", "how much later it started")]
    work_s: Annotated[float, About("tick", "how long it took, up to its record")]
    source_s: Annotated[float, About("tick", "time in the trajectory")]
    robots: tuple[RobotRecord, ...]


@dataclass(frozen=True, slots=True)
class Value:
    """A declared value with its place.

    Attributes:
        name: in its part of the record.
        place: of its first number there.
        numbers: 1, or 3 for a vector.
        json: its JSON type.
        about: the rest of its declaration.
    """

    name: str
    place: int
    numbers: int
    json: str
    about: About


class RecordPart:
    """One of the three kinds of records as flat numbers.

    Attributes:
        values: in order.
        format: of `struct`.
        size: numbers.
        pick: the arguments of the named tuple from a slice of a record.
        blank: numbers of a record in which everything is absent; to be copied.
    """

    _TYPES: Final = {int: ("Q", 1, "integer"), float: ("d", 1, "number"), Vec3: ("3d", 3, "array")}

    def __init__(self, record: type[tuple[Any, ...]]) -> None:
        values, form, place = [], "", 0
        for name, hint in get_type_hints(record, include_extras=True).items():
            if (parts := get_args(hint)) and isinstance(about := parts[-1], About):
                code, numbers, kind = self._TYPES[parts[0]]
                values.append(Value(name, place, numbers, about.json or kind, about))
                form, place = form + code, place + numbers
        self.values: tuple[Value, ...] = tuple(values)
        self.format, self.size = form, place
        self.pick: Callable[[Sequence[float]], tuple[Any, ...]] = itemgetter(
            *(each.place if each.numbers == 1 else slice(each.place, each.place + 3) for each in values)
        )
        self.blank: list[float] = [
            math.nan if each.json in ("number", "array") else 0
            for each in values
            for _ in range(each.numbers)
        ]
        self._places = {each.name: each.place for each in values}

    def place(self, name: str) -> int:
        """Place of the first number of a value."""
        return self._places[name]

    def vector(self, name: str) -> slice:
        """Place of a vector."""
        return slice(self._places[name], self._places[name] + 3)


HEAD: Final = RecordPart(TickRecord)
ROBOT: Final = RecordPart(RobotRecord)
AXIS: Final = RecordPart(AxisRecord)

# Places of the values of the tick itself.
TICK: Final = HEAD.place("tick")
SKIPPED: Final = HEAD.place("skipped")
DEADLINE: Final = HEAD.place("deadline_s")
LATENESS: Final = HEAD.place("lateness_s")
WORK: Final = HEAD.place("work_s")
SOURCE_TIME: Final = HEAD.place("source_s")


@dataclass(frozen=True, slots=True)
class RobotLayout:
    """A robot as a reader of records needs it: name, model, unit suffix of its actuation, axes.

    Attributes:
        name: in the robot file.
        model: of its kinematics.
        quantity: unit suffix of the model's axes.
        axes: names of all axes.
        angles: how many of them, the last ones, are in degrees.
    """

    name: str
    model: str
    quantity: str
    axes: tuple[str, ...]
    angles: int = 0

    @property
    def units(self) -> tuple[str, ...]:
        """Unit suffix of every axis."""
        return (self.quantity,) * (len(self.axes) - self.angles) + ("deg",) * self.angles


@dataclass(frozen=True, slots=True)
class RecordLayout:
    """The robots of a record, and with them the place of every value."""

    name: str
    rate_hz: float
    robots: tuple[RobotLayout, ...]

    def packer(self) -> struct.Struct:
        """The whole record as one struct."""
        robots = "".join(ROBOT.format + AXIS.format * len(robot.axes) for robot in self.robots)
        return struct.Struct("=" + HEAD.format + robots)

    def robot_start(self, robot: int) -> int:
        """Place of the first value of a robot."""
        return HEAD.size + sum(ROBOT.size + AXIS.size * len(each.axes) for each in self.robots[:robot])

    def axis_start(self, robot: int, axis: int) -> int:
        """Place of the first value of an axis."""
        return self.robot_start(robot) + ROBOT.size + AXIS.size * axis

    def robot_place(self, robot: int, name: str) -> int:
        """Place of a value of a robot."""
        return self.robot_start(robot) + ROBOT.place(name)

    def axis_place(self, robot: int, axis: int, name: str) -> int:
        """Place of a value of an axis."""
        return self.axis_start(robot, axis) + AXIS.place(name)

    def to_json(self) -> str:
        """The layout for the head of the ring."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> RecordLayout:
        """The layout back from the head of the ring."""
        raw = json.loads(text)
        robots = tuple(RobotLayout(**{**robot, "axes": tuple(robot["axes"])}) for robot in raw["robots"])
        return cls(raw["name"], raw["rate_hz"], robots)

    def decode(self, values: tuple[float, ...]) -> TickRecord:
        """A record from the numbers of `packer`."""
        robots, at = [], HEAD.size
        for robot in self.robots:
            end = at + ROBOT.size + AXIS.size * len(robot.axes)
            robots.append(_robot(values[at:end]))
            at = end
        return TickRecord._make((*HEAD.pick(values), tuple(robots)))

    def robot(self, values: Sequence[float], index: int) -> RobotRecord:
        """One robot of a record, likewise."""
        return _robot(tuple(values[self.robot_start(index) : self.robot_start(index + 1)]))


def _robot(values: tuple[float, ...]) -> RobotRecord:
    """A robot from its own numbers: its values, then those of its axes."""
    places = range(ROBOT.size, len(values), AXIS.size)
    axes = tuple([AxisRecord(*values[at : at + AXIS.size]) for at in places])
    return RobotRecord._make((*ROBOT.pick(values), axes))
