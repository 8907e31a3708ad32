"""Robots and buses as clients see them: status, telemetry and description, from the newest record.

Edge units with the unit in the key; positions in the world frame.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import TicksSkipped, TicksWaited
from contid.control.engine.events.robots import FaultLatched
from contid.control.engine.measured_tip import measured_actuation
from contid.control.engine.tick_layout import ENABLED, UNRESTED, RecordLayout, RobotRecord, TickRecord
from contid.control.engine.wiring import build_robot_configs, record_layout
from contid.control.process.isolation.model_answers import ModelAnswers
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import PAGES, Fault
from contid.control.tick.supervisor import Mode
from contid.remote.protocol.wire import Code, Fields, RemoteError, RequestFields
from contid.remote.server.robot_fields import (
    MODEL_FIELDS,
    PER_AXIS,
    bends_of,
    bus_health,
    commanded,
    field_of,
    finite,
    limit_names,
    milliseconds,
    response_fields,
)
from contid.robot_file.load import LoadedFile
from contid.robot_file.proven.bringup import proofs
from contid.trajectory.columns import vocabulary


def fault_fields(fault: Fault, detail: str) -> Fields | None:
    """A latched fault with cause, reaction and remedy; None when there is none."""
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
    """The robots of one daemon as clients see them.

    Attributes:
        configs, robots: by name.
        layout: of the records.
        answers: of isolated models, which are to be asked before `field` and `status`.
    """

    def __init__(self, loaded: LoadedFile, rate_hz: float, refresh: Callable[[], None]) -> None:
        """View the robots of a file; ``refresh`` fetches the events up to the newest record."""
        self.configs: dict[str, RobotConfig] = {
            config.name: config for config in build_robot_configs(loaded, rate_hz)
        }
        self.robots = loaded.driven
        self.layout: RecordLayout = record_layout(loaded, rate_hz)
        self._loaded = loaded
        self._details: dict[str, str] = {}
        self._waited, self._longest_gap_ms = 0, 0.0
        self._refresh = refresh
        self.answers = ModelAnswers(loaded, MODEL_FIELDS, self._field)
        self._index = {robot.name: number for number, robot in enumerate(self.layout.robots)}
        self._axes_of = {
            name: tuple(axis for axis, _ in bus.axes) for name, bus in loaded.buses.items() if bus.axes
        }

    def notice(self, event: RunEvent) -> None:
        """Keep what records do not have: details of faults, periods waited for, the longest gap."""
        match event:
            case FaultLatched():
                self._details[event.robot] = event.detail
            case TicksWaited():
                self._waited, self._longest_gap_ms = event.total, event.longest_gap_ms
            case TicksSkipped():
                self._longest_gap_ms = event.longest_gap_ms

    def check(self, robots: Sequence[str] | None) -> None:
        """Refuse unknown robots."""
        for name in robots or ():
            if name not in self.configs:
                message = f"no robot {name!r}; there are {', '.join(self.configs)}"
                raise RemoteError(Code.UNKNOWN_ROBOT, message)

    def named(self, request: RequestFields) -> tuple[str, ...] | None:
        """The robots that a request names, None for all.

        Raises:
            RemoteError: one is unknown.
        """
        robots = request.names("robots")
        self.check(robots)
        return None if robots is None else tuple(dict.fromkeys(robots))

    def faults(self, record: TickRecord | None, robots: Sequence[str] | None) -> dict[str, Fields]:
        """The latched faults of robots, of all for None."""
        if record is None:
            return {}
        found = ((name, self._fault(name, self._of(name, record))) for name in self._names(robots))
        return {name: fault for name, fault in found if fault is not None}

    def _names(self, robots: Sequence[str] | None) -> Sequence[str]:
        return tuple(self.configs) if robots is None else robots

    def _of(self, robot: str, record: TickRecord) -> RobotRecord:
        return record.robots[self._index[robot]]

    def _fault(self, robot: str, record: RobotRecord) -> Fields | None:
        if record.fault:
            # The event with its detail precedes this record, but may not have been fetched yet.
            self._refresh()
        return fault_fields(Fault(record.fault), self._details.get(robot, ""))

    def mode(self, robot: str, record: TickRecord | None) -> Mode:
        """The state of a robot."""
        return Mode.OFF if record is None else Mode(self._of(robot, record).mode)

    def silent(self, robots: Sequence[str] | None, record: TickRecord | None) -> dict[str, list[str]]:
        """By robot, the axes that an order to stop may not have reached.

        Their devices did not answer in the newest tick, or are not yet at rest as asked.
        """
        silent: dict[str, list[str]] = {}
        if record is not None:
            for name in self._names(robots):
                found = self._of(name, record)
                samples = zip(self.configs[name].axis_names, found.axes, strict=True)
                unrested = bool(found.flags & UNRESTED)
                silent[name] = [axis for axis, sample in samples if unrested or sample.valid != 1.0]
        return {name: axes for name, axes in silent.items() if axes}

    def command(self, robot: str, record: TickRecord | None) -> tuple[float, ...] | None:
        """The last commanded actuation [m or Pa], None before the first."""
        return None if record is None else commanded(self._of(robot, record))

    # -- responses ---------------------------------------------------------------------------------------

    def describe(self) -> Fields:
        """What does not change: robots, axes, limits, columns."""
        robots: Fields = {}
        proven = proofs(self._loaded)
        for name, config in self.configs.items():
            unit = config.quantity.unit
            limits = zip(
                config.axis_names, config.model.lower, config.model.upper, config.quantities, strict=True
            )
            rates = {
                "velocity": (config.velocity, "s"),
                "acceleration": (config.acceleration, "s2"),
                "jerk": (config.jerk, "s3"),
            }
            robots[name] = {
                "model": config.kind,
                "unit": unit,
                "columns": list(vocabulary(self.robots[name])),
                **{
                    f"{what}_{quantity.unit}_{per}": limit * quantity.per_si
                    for what, (of_axes, per) in rates.items()
                    for quantity, limit in dict(zip(config.quantities, of_axes, strict=True)).items()
                },
                "stop": {reason: policy.value for reason, policy in config.stops},
                "axes": {
                    axis: {
                        f"min_{each.unit}": minimum * each.per_si,
                        f"max_{each.unit}": maximum * each.per_si,
                    }
                    for axis, minimum, maximum, each in limits
                },
                "follow": {
                    axis: response_fields(response, quantity.unit, quantity.per_si * response.unit)
                    for axis, response, quantity in zip(
                        config.axis_names, config.responses, config.quantities, strict=True
                    )
                },
                "bringup": {axis: proven[f"{name}.{axis}"].as_fields() for axis in config.axis_names},
            }
        return {
            "name": self._loaded.file.name,
            "file": str(self._loaded.path.absolute()),
            "file_sha256": self._loaded.sha256,
            "robots": robots,
        }

    def status(self, record: TickRecord | None, now_s: float, costs_s: Sequence[float]) -> Fields:
        """Buses and robots at a time, on the clock of the record; ``costs_s`` of a tick of each robot."""
        if record is None:
            return {"tick": None, "buses": {}, "robots": {name: {"state": "OFF"} for name in self.configs}}
        buses = bus_health(self.layout, record, self._axes_of, now_s)
        return {
            "tick": record.tick,
            "tick_age_ms": milliseconds(now_s - record.deadline_s),
            "skipped": record.skipped,
            "waited": self._waited,
            "longest_gap_ms": self._longest_gap_ms,
            "work_ms": milliseconds(record.work_s),
            "source_s": finite(record.source_s),
            "buses": {
                name: {"driver": self._loaded.buses[name].driver, **health} for name, health in buses.items()
            },
            "robots": {
                name: {**self._robot(name, record), "tick_ms": milliseconds(cost_s)}
                for name, cost_s in zip(self.configs, costs_s, strict=True)
            },
        }

    def field(self, record: TickRecord, robot: str, field: str) -> Any:
        """One of `FIELDS` of a robot at one tick, `answers` of it included."""
        return self.answers.value(record, robot, field)

    def _field(self, record: TickRecord, robot: str, field: str) -> Any:
        if field == "bends":
            return bends_of(self.configs[robot], self.robots[robot], self._of(robot, record))
        return field_of(self.configs[robot], self._of(robot, record), field)

    def _robot(self, name: str, newest: TickRecord) -> Fields:
        config, record = self.configs[name], self._of(name, newest)
        measured = measured_actuation(config, record)
        axes = {}
        for number, (axis, sample) in enumerate(zip(config.axis_names, record.axes, strict=True)):
            scale, unit = config.quantities[number].per_si, config.quantities[number].unit
            axes[axis] = {
                f"measured_{unit}": None if measured is None else measured[number] * scale,
                f"command_{unit}": finite(sample.command * scale),
                f"difference_{unit}": None
                if measured is None
                else finite((measured[number] - sample.command) * scale),
                f"min_{unit}": config.model.lower[number] * scale,
                f"max_{unit}": config.model.upper[number] * scale,
                "valid": sample.valid == 1.0,
                "limits": limit_names(int(sample.limits)),
                **{key: finite(getattr(sample, key)) for key in PER_AXIS},
            }
        return {
            "state": Mode(record.mode).name,
            "enabled": bool(record.flags & ENABLED),
            "fault": self._fault(name, record),
            **{key: self.field(newest, name, key) for key in ("tip_mm", "target_mm", "error_mm")},
            **{
                key: load
                for key in ("estimated_load_n", "estimated_sigma_n")
                if (load := field_of(config, record, key)) is not None
            },
            "unit": config.quantity.unit,
            "axes": axes,
        }
