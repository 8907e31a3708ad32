"""What clients are told about the robots: status, telemetry and description, made from the newest record.

Edge units with the unit in the key; positions in the world frame. ``tip_mm`` is where the model says that the
measured actuation puts the tip (the commanded one while an axis has no valid sample).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any, Final

from contid.control.engine.events import FaultLatched, RunEvent
from contid.control.engine.tick_layout import ENABLED, HAS_TARGET, RecordLayout, RobotRecord, TickRecord
from contid.control.engine.wiring import build_robot_configs, driven_robots, record_layout
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import PAGES, Fault
from contid.control.tick.limits import FLAG_NAMES
from contid.control.tick.supervisor import Mode
from contid.remote.protocol.wire import Code, Fields, RemoteError, RequestFields
from contid.remote.server.health import bus_health
from contid.robot_file.load import LoadedFile
from contid.trajectory.columns import vocabulary
from contid.units import m_to_mm

#: What `subscribe` may choose from, and what it sends when nothing is chosen.
FIELDS: Final = (
    "state", "fault", "tip_mm", "target_mm", "error_mm", "command", "measured", "limits", "age_ms", "effort",
    "temperature_c", "voltage_v", "measured_tip_mm", "measured_direction",
)  # fmt: skip
DEFAULT_FIELDS: Final = ("state", "fault", "tip_mm", "command", "measured")
_PER_AXIS: Final = ("effort", "temperature_c", "voltage_v")


def fault_fields(fault: Fault, detail: str) -> Fields | None:
    """Everything a person needs to know about a latched fault; None when there is none."""
    if fault is Fault.NONE:
        return None
    page = PAGES[fault]
    return {
        "number": int(fault),
        "name": fault.name.lower().replace("_", "-"),
        "what": detail,
        "cause": page.cause,
        "reaction": page.reaction,
        "remedy": page.remedy,
        "page": f"docs/faults/{int(fault)}.md",
    }


class TelemetryView:
    """The robots of one daemon as clients see them."""

    def __init__(self, loaded: LoadedFile, rate_hz: float, refresh: Callable[[], None]) -> None:
        """See a robot file's robots; ``refresh`` brings the events that belong to a record."""
        self.configs: dict[str, RobotConfig] = {
            config.name: config for config in build_robot_configs(loaded, rate_hz)
        }
        self.robots = driven_robots(loaded)
        self.layout: RecordLayout = record_layout(loaded, rate_hz)
        self._loaded = loaded
        self._details: dict[str, str] = {}
        self._refresh = refresh
        self._index = {robot.name: number for number, robot in enumerate(self.layout.robots)}
        self._axes_of = {
            name: tuple(axis for axis, _ in bus.axes) for name, bus in loaded.buses.items() if bus.axes
        }

    def notice(self, event: RunEvent) -> None:
        """Keep the words of a fault: a record has its number only."""
        if isinstance(event, FaultLatched):
            self._details[event.robot] = event.detail

    def check(self, robots: Sequence[str] | None) -> None:
        """Raise for a robot that is not there."""
        for name in robots or ():
            if name not in self.configs:
                known = ", ".join(self.configs)
                raise RemoteError(Code.UNKNOWN_ROBOT, f"no robot {name!r}; there are {known}")

    def named(self, request: RequestFields) -> tuple[str, ...] | None:
        """The robots that a request names, None for all of them.

        Raises:
            RemoteError: one is not there.
        """
        robots = request.names("robots")
        self.check(robots)
        return robots

    def faults(self, record: TickRecord | None, robots: Sequence[str] | None) -> dict[str, Fields]:
        """The faults of robots, of all of them for None."""
        out = {}
        for name in robots if robots is not None else tuple(self.configs):
            told = self.fault(name, record)
            if told is not None:
                out[name] = told
        return out

    def fault(self, robot: str, record: TickRecord | None) -> Fields | None:
        """The latched fault of a robot."""
        if record is None:
            return None
        return self._fault(robot, record.robots[self._index[robot]])

    def _fault(self, robot: str, told: RobotRecord) -> Fields | None:
        if told.fault:
            # Its words are an event that came before this record, but may not have been fetched yet.
            self._refresh()
        return fault_fields(Fault(told.fault), self._details.get(robot, ""))

    def mode(self, robot: str, record: TickRecord | None) -> Mode:
        """The state of a robot."""
        return Mode.OFF if record is None else Mode(record.robots[self._index[robot]].mode)

    def silent(self, robots: Sequence[str] | None, record: TickRecord | None) -> dict[str, list[str]]:
        """By robot, the axes whose devices did not answer in the newest tick: no order reaches them."""
        out: dict[str, list[str]] = {}
        if record is None:
            return out
        for name in robots if robots is not None else tuple(self.configs):
            told = record.robots[self._index[name]].axes
            axes = [
                a for a, seen in zip(self.configs[name].axis_names, told, strict=True) if seen.valid != 1.0
            ]
            if axes:
                out[name] = axes
        return out

    def command(self, robot: str, record: TickRecord | None) -> tuple[float, ...] | None:
        """The last commanded actuation [m or Pa], None before the first."""
        if record is None:
            return None
        command = tuple(axis.command for axis in record.robots[self._index[robot]].axes)
        return command if all(map(math.isfinite, command)) else None

    # -- what is told ------------------------------------------------------------------------------------

    def describe(self) -> Fields:
        """What does not change: robots, axes, limits, columns."""
        robots: Fields = {}
        for name, config in self.configs.items():
            scale, unit = config.quantity.per_si, config.quantity.unit
            robots[name] = {
                "model": config.kind,
                "unit": unit,
                "columns": list(vocabulary(self.robots[name])),
                f"velocity_{unit}_s": config.velocity * scale,
                "stop": {key: getattr(config.stops, key).value for key in config.stops.__slots__},
                "axes": {
                    axis: {f"lower_{unit}": low * scale, f"upper_{unit}": high * scale}
                    for axis, low, high in zip(
                        config.axis_names, config.model.lower, config.model.upper, strict=True
                    )
                },
            }
        return {"name": self._loaded.file.name, "file": str(self._loaded.path), "robots": robots}

    def status(self, record: TickRecord | None, now_s: float | None = None) -> Fields:
        """Buses and robots now."""
        now_s = time.monotonic() if now_s is None else now_s
        if record is None:
            return {"tick": None, "buses": {}, "robots": {name: {"state": "OFF"} for name in self.configs}}
        health = bus_health(self.layout, record, self._axes_of, now_s)
        return {
            "tick": record.tick,
            "tick_age_ms": _ms(now_s - record.deadline_s),
            "skipped": record.skipped,
            "work_ms": _ms(record.work_s),
            "source_s": _number(record.source_s),
            "buses": {
                name: {
                    "driver": self._loaded.buses[name].driver,
                    "tier": bus.tier.value,
                    "age_ms": _ms(bus.age_s),
                    "silent": list(bus.silent),
                }
                for name, bus in health.items()
            },
            "robots": {name: self._robot(name, record) for name in self.configs},
        }

    def telemetry(self, record: TickRecord, robots: Sequence[str], fields: Sequence[str]) -> Fields:
        """The chosen fields of the chosen robots at one tick."""
        out: Fields = {}
        for name in robots:
            config, told = self.configs[name], record.robots[self._index[name]]
            out[name] = {field: self._field(config, told, field) for field in fields}
        return {"tick": record.tick, "t_s": record.deadline_s, "robots": out}

    def _field(self, config: RobotConfig, told: RobotRecord, field: str) -> Any:
        scale = config.quantity.per_si
        match field:
            case "state":
                return Mode(told.mode).name
            case "fault":
                return told.fault
            case "tip_mm":
                return self.tip_mm(config, told)
            case "target_mm":
                return [m_to_mm(value) for value in told.tip_m] if told.flags & HAS_TARGET else None
            case "error_mm":
                return _number(m_to_mm(told.tip_error_m))
            case "command":
                return [_number(axis.command * scale) for axis in told.axes]
            case "measured":
                measured = _measured(config, told)
                return None if measured is None else [value * scale for value in measured]
            case "limits":
                return [_limits(int(axis.limits)) for axis in told.axes]
            case "measured_tip_mm":
                seen = told.measured_tip_m
                return [m_to_mm(value) for value in seen] if all(map(math.isfinite, seen)) else None
            case "measured_direction":
                towards = told.measured_direction
                return list(towards) if all(map(math.isfinite, towards)) else None
            case "age_ms":
                return [_ms(axis.age_s) for axis in told.axes]
        assert field in _PER_AXIS
        return [_number(getattr(axis, field)) for axis in told.axes]

    def _robot(self, name: str, record: TickRecord) -> Fields:
        config, told = self.configs[name], record.robots[self._index[name]]
        scale, unit = config.quantity.per_si, config.quantity.unit
        measured = _measured(config, told)
        axes = {}
        for number, (axis, sample) in enumerate(zip(config.axis_names, told.axes, strict=True)):
            axes[axis] = {
                f"measured_{unit}": None if measured is None else measured[number] * scale,
                f"command_{unit}": _number(sample.command * scale),
                f"lower_{unit}": config.model.lower[number] * scale,
                f"upper_{unit}": config.model.upper[number] * scale,
                "valid": sample.valid == 1.0,
                "limits": _limits(int(sample.limits)),
                **{key: _number(getattr(sample, key)) for key in _PER_AXIS},
            }
        return {
            "state": Mode(told.mode).name,
            "enabled": bool(told.flags & ENABLED),
            "fault": self._fault(name, told),
            "tip_mm": self.tip_mm(config, told),
            "target_mm": self._field(config, told, "target_mm"),
            "error_mm": self._field(config, told, "error_mm"),
            "unit": unit,
            "axes": axes,
        }

    def tip_mm(self, config: RobotConfig, told: RobotRecord) -> list[float] | None:
        """Where the model says the tip is."""
        actuation = _measured(config, told)
        if actuation is None:
            actuation = tuple(axis.command for axis in told.axes)
            if not all(map(math.isfinite, actuation)):
                return None
        try:
            tip = config.frame.point_in_world(config.model.forward(actuation).tip_m)
        except (ValueError, ArithmeticError):  # measured outside what the model knows
            return None
        return [m_to_mm(value) for value in tip] if all(map(math.isfinite, tip)) else None


def _measured(config: RobotConfig, told: RobotRecord) -> tuple[float, ...] | None:
    """Measured actuation [m or Pa], None while an axis has never been read."""
    values = tuple(axis.value for axis in told.axes)
    if not all(map(math.isfinite, values)):
        return None
    return config.transmission.to_actuation(values)


def _limits(bits: int) -> list[str]:
    return [name for bit, name in FLAG_NAMES.items() if bits & bit]


def _ms(seconds: float) -> float | None:
    return round(seconds * 1e3, 3) if math.isfinite(seconds) else None


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
