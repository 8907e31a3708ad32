"""Values of one robot at one tick, in the units of files, as clients get them; None where there is none.

``tip_mm`` is the model's tip at the measured actuation with the known load (at the commanded one while an
axis has no valid sample), ``command_tip_mm`` that at the commanded one; both in the world frame. Those at the
commanded one are also ``bends``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from contid.control.engine.measured_tip import measured_actuation, tip_in_world
from contid.control.engine.staleness import staleness_of
from contid.control.engine.tick_layout import HAS_TARGET, RecordLayout, RobotRecord, TickRecord
from contid.control.tick.config import RobotConfig
from contid.control.tick.follow.expected_range import AxisResponse
from contid.control.tick.limits import FLAG_NAMES
from contid.control.tick.supervisor import Mode
from contid.kinematics.model import Bending
from contid.remote.protocol.wire import Fields
from contid.robot_file.robot import RobotDescription
from contid.targets import Vec3, load_or_zero
from contid.trajectory.arc_columns import arc_values
from contid.units import m_to_mm

#: The fields of telemetry, and those sent by default.
FIELDS: Final = (
    "state", "fault", "tip_mm", "command_tip_mm", "target_mm", "error_mm", "command", "measured", "limits",
    "age_ms", "effort", "temperature_c", "voltage_v", "tension_n", "measured_tip_mm", "measured_direction",
    "estimated_load_n", "estimated_sigma_n", "bends",
)  # fmt: skip
#: Those that a model answers.
MODEL_FIELDS: Final = frozenset({"tip_mm", "command_tip_mm", "bends"})
DEFAULT_FIELDS: Final = ("state", "fault", "tip_mm", "command", "measured")
PER_AXIS: Final = ("effort", "temperature_c", "voltage_v", "tension_n")


def bends_of(config: RobotConfig, robot: RobotDescription, record: RobotRecord) -> list[float] | None:
    """Values of `contid.trajectory.arc_columns.arc_names` at the commanded actuation, with the known load."""
    command = commanded(record)
    if command is None or not isinstance(config.model, Bending):
        return None
    load_in_base = config.frame.vector_in_base(load_or_zero(record.load_n))
    return arc_values(robot, config.model.arcs(command, load_in_base).tolist())


def field_of(config: RobotConfig, record: RobotRecord, field: str) -> Any:
    """One of `FIELDS` of a robot, without `bends_of`."""
    scales = [each.per_si for each in config.quantities]
    match field:
        case "state":
            return Mode(record.mode).name
        case "fault":
            return record.fault
        case "tip_mm":
            return _tip_mm(config, record, measured_actuation(config, record) or commanded(record))
        case "command_tip_mm":
            return _tip_mm(config, record, commanded(record))
        case "target_mm":
            return [m_to_mm(value) for value in record.tip_m] if record.flags & HAS_TARGET else None
        case "error_mm":
            return finite(m_to_mm(record.tip_error_m))
        case "command":
            return [finite(axis.command * scale) for axis, scale in zip(record.axes, scales, strict=True)]
        case "measured":
            measured = measured_actuation(config, record)
            if measured is None:
                return None
            return [value * scale for value, scale in zip(measured, scales, strict=True)]
        case "limits":
            return [limit_names(int(axis.limits)) for axis in record.axes]
        case "measured_tip_mm":
            return _mm(record.measured_tip_m)
        case "measured_direction":
            return all_finite(record.measured_direction)
        case "estimated_load_n" | "estimated_sigma_n":
            load = all_finite(getattr(record, field))
            return None if load is None else list(load)
        case "age_ms":
            return [milliseconds(axis.age_s) for axis in record.axes]
    assert field in PER_AXIS
    return [finite(getattr(axis, field)) for axis in record.axes]


def response_fields(response: AxisResponse, unit: str, per_device: float) -> dict[str, float | None]:
    """How a healthy axis answers, in the unit of its column: ``per_device`` of it in one of its device."""
    return {
        f"tolerance_{unit}": response.tolerance * per_device,
        f"top_{unit}_s": finite(response.top * per_device),
        "pushing_a": finite(response.pushing_a),
        **{
            f"{each}_ms": 1e3 * getattr(response, f"{each}_s")
            for each in ("delay", "lag", "overshoot", "least_delay", "least_lag")
        },
    }


def commanded(record: RobotRecord) -> tuple[float, ...] | None:
    """The commanded actuation [m or Pa]; None before the first."""
    return all_finite(axis.command for axis in record.axes)


def _tip_mm(
    config: RobotConfig, record: RobotRecord, actuation: tuple[float, ...] | None
) -> list[float] | None:
    """The model's tip in the world frame [mm], with the known load."""
    tip = None if actuation is None else tip_in_world(config, actuation, record.load_n)
    return None if tip is None else _mm(tip)


def all_finite(values: Iterable[float]) -> tuple[float, ...] | None:
    """The values; None when one is not finite."""
    found = tuple(values)
    return found if all(map(math.isfinite, found)) else None


def _mm(position_m: Vec3) -> list[float] | None:
    return [m_to_mm(value) for value in position_m] if all_finite(position_m) else None


def limit_names(bits: int) -> list[str]:
    """Names of the limits in the bits of an axis."""
    return [name for bit, name in FLAG_NAMES.items() if bits & bit]


def milliseconds(seconds: float) -> float | None:
    """Milliseconds with three decimals; None when not finite."""
    return round(seconds * 1e3, 3) if math.isfinite(seconds) else None


def finite(value: float) -> float | None:
    """The value; None when it is not finite, which JSON lacks."""
    return value if math.isfinite(value) else None


def bus_health(
    layout: RecordLayout, record: TickRecord, axes_of: Mapping[str, Sequence[str]], now_s: float
) -> dict[str, Fields]:
    """By bus the age of the data of its oldest axis, the tier of that age, and its silent axes.

    The age is None before the first valid sample of every axis; an axis is silent that the newest exchange
    did not read.

    Args:
        layout: of the record.
        record: the newest one.
        axes_of: axes by bus, as ``ROBOT.AXIS``.
        now_s: the time now, on the clock of the record.
    """
    samples = {
        f"{robot.name}.{axis}": sample
        for robot, values in zip(layout.robots, record.robots, strict=True)
        for axis, sample in zip(robot.axes, values.axes, strict=True)
    }
    health = {}
    for bus, axes in axes_of.items():
        read = {axis: samples[axis] for axis in axes if axis in samples}
        ages = (math.inf if math.isnan(s.value) else now_s - s.time_s for s in read.values())
        age_s = max(ages, default=math.inf)
        health[bus] = {
            "tier": staleness_of(age_s, 1.0 / layout.rate_hz).value,
            "age_ms": milliseconds(max(age_s, 0.0)),
            "silent": [axis for axis, sample in read.items() if sample.valid != 1.0],
        }
    return health
