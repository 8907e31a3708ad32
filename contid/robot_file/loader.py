"""One pass over a document: every valid part built, every mistake found with its place."""

from __future__ import annotations

import copy
import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from contid.errors import MAX_FINDINGS, Located
from contid.hal import BUILT_IN, Driver, LimitsRate, Restricts, UnknownDriverError, driver_names, load_driver
from contid.robot_file.base import AxisDescription
from contid.robot_file.chain import Chain, check_chain
from contid.robot_file.checks import WiredAxis, check_name, check_robot
from contid.robot_file.clearance import check_clearance
from contid.robot_file.document import (
    MAX_RATE_HZ,
    AnyRobot,
    BusDescription,
    BusWiring,
    Isolation,
    RobotFile,
    check_ports,
)
from contid.robot_file.findings import allowed_names, explain, shown
from contid.robot_file.gravity import check_one_world
from contid.robot_file.model_plugins import ModelPluginError, load_plugin, plugin_names
from contid.robot_file.positions import Data, Document, KeyPath, step_into
from contid.robot_file.rates import check_shapes
from contid.robot_file.robot import RobotDescription
from contid.robot_file.sections import check_rest_poses
from contid.robot_file.tick_rate import rate_too_high, watchdog_too_short

_Part = TypeVar("_Part", bound=BaseModel)

#: Keys of a bus and of an axis that belong to contid; the others belong to the driver.
BUS_KEYS: Final = tuple(BusDescription.model_fields)
AXIS_KEYS: Final = tuple(AxisDescription.model_fields)


class Loader:
    """One pass over a document; collects findings, and builds every valid part."""

    def __init__(self, document: Document, recorded: bool) -> None:
        self.document = document
        #: From a session: its rate and options are not checked, they were possible with the driver of then.
        self.recorded = recorded
        self.findings: list[Located] = []
        self.drivers: dict[str, Driver] = {}
        self.axes: dict[str, list[tuple[str, BaseModel]]] = {}
        self.addresses: dict[tuple[str, str], str] = {}

    def load(self) -> dict[str, BusWiring]:
        """Check everything; returns the buses with their axes, none when findings are too many."""
        data = self.document.data
        if not isinstance(data, dict):
            message = f"a robot file is a mapping; {allowed_names(RobotFile.model_fields)}"
            self.findings.append(self.document.at_value((), message))
            return {}
        head = dict(data)
        for part in ("buses", "robots"):
            if isinstance(data.get(part), dict):
                head[part] = {}
                if not data[part]:
                    self.findings.append(self.document.at_key((part,), f"{part}: at least one is needed"))
        whole = self._validated(RobotFile, head, ())
        buses, robots = _mapping(data.get("buses")), _mapping(data.get("robots"))
        self.axes = {name: [] for name in buses}
        wirings = {name: self._bus(name, raw) for name, raw in buses.items() if not self.too_many_findings}
        described = {
            name: self._robot(name, raw) for name, raw in robots.items() if not self.too_many_findings
        }
        if self.too_many_findings:
            return {}
        complete = {name: replace(bus, axes=tuple(self.axes[name])) for name, bus in wirings.items() if bus}
        rate_hz = data.get("rate_hz")
        if isinstance(rate_hz, int | float) and rate_hz is not True and 0.0 < rate_hz <= MAX_RATE_HZ:
            wrong = [*watchdog_too_short(complete.values(), rate_hz)]
            wrong += () if self.recorded else rate_too_high(complete.values(), rate_hz)
            self.findings += [self.document.at_value(("rate_hz",), f"rate_hz: {each}") for each in wrong]
        for name, bus in complete.items():
            driver = self.drivers[name]
            if isinstance(driver, Restricts) and not self.recorded:
                for key, message in driver.refused(bus.options, bus.axes):
                    at = ("buses", name, key)
                    self.findings.append(self.document.at_value(at, f"{key}: {message}"))
        for name, robot in described.items():
            if isinstance(robot, Chain):
                self.findings += check_chain(self.document, ("robots", name), robot, described)
        if not self.recorded:
            self.findings += check_ports(self.document, complete.values())
            self.findings += check_one_world(self.document, described)
            # Values that replace refused ones, and too few numbers of a rest pose, are not compared.
            self.findings += () if self.findings else check_rest_poses(self.document, described)
        self.findings += check_shapes(
            self.document, whole is not None and whole.clearance is not None, described
        )
        if whole is not None and whole.clearance is not None:
            self.findings += check_clearance(self.document, whole.clearance, described)
        return complete

    @property
    def too_many_findings(self) -> bool:
        """True with more findings than are listed; further parts are then not checked."""
        return len(self.findings) > MAX_FINDINGS

    def _validated(
        self, kind: type[_Part], data: Data, at: KeyPath, also: Sequence[str] = ()
    ) -> _Part | None:
        """``data`` as a ``kind``; mistakes become findings and are replaced where possible.

        ``at`` is the path of ``data`` in the document; ``also`` are further keys allowed there.
        """
        try:
            return kind.model_validate_json(json.dumps(data), strict=True)
        except ValidationError as error:
            self.findings += explain(error, self.document, at, kind, also)
            return None if self.too_many_findings else recover(kind, data)

    def _bus(self, name: str, raw: Data) -> BusWiring | None:
        at: KeyPath = ("buses", name)
        self.findings += check_name(self.document, at)
        common = self._validated(BusDescription, _contid_keys(raw, BUS_KEYS), at)
        if not isinstance(raw, dict) or not isinstance(raw.get("driver"), str) or common is None:
            return None
        try:
            self.drivers[name] = driver = load_driver(common.driver)
        except UnknownDriverError as error:
            names = driver_names()
            message = (
                f"driver: {shown(common.driver)} is not installed; {allowed_names(names, common.driver)}"
            )
            if common.driver in names:  # installed, and its import failed
                message = str(error)
            self.findings.append(self.document.at_value((*at, "driver"), message))
            return None
        options = self._validated(driver.bus_options, _driver_keys(raw, BUS_KEYS), at, BUS_KEYS)
        if options is None:
            return None
        where = common.isolation or (Isolation.THREAD if common.driver in BUILT_IN else Isolation.PROCESS)
        return BusWiring(name, common.driver, options, (), common.tolerance_ticks, where)

    def _robot(self, name: str, raw: Data) -> RobotDescription | None:
        at: KeyPath = ("robots", name)
        self.findings += check_name(self.document, at)
        if not isinstance(raw, dict):
            message = f"{name}: a robot is a mapping of keys to values, not {shown(raw)}"
            self.findings.append(self.document.at_value(at, message))
            return None
        before = len(self.findings)
        wired = {
            axis: self._axis((*at, "axes", axis), each)
            for axis, each in _mapping(raw.get("axes")).items()
            if not self.too_many_findings
        }
        if self.too_many_findings:
            return None
        kinds = robot_classes()
        model = raw.get("model")
        if isinstance(model, str) and model not in kinds and model in plugin_names():
            try:
                kinds[model] = load_plugin(model).description
            except ModelPluginError as error:
                self.findings.append(self.document.at_value((*at, "model"), str(error)))
                return None
        if not isinstance(model, str) or model not in kinds:
            what = f"model: {shown(model)} is not possible" if "model" in raw else "key 'model' is missing"
            message = f"{what}; {allowed_names([*kinds, *plugin_names()], str(model))}"
            self.findings.append(self.document.at_value((*at, "model"), message))
            return None
        # The axes were validated one by one, with the keys of their drivers.
        axes: Data = {} if isinstance(raw.get("axes"), dict) else raw.get("axes", {})
        robot = self._validated(kinds[model], {**raw, "axes": axes}, at)
        if len(self.findings) > before:  # rates would be compared with values that replace refused ones
            wired = {axis: replace(each, rate=None) for axis, each in wired.items()}
        if robot is not None:
            self.findings += check_robot(self.document, at, robot, wired)
        return robot

    def _axis(self, at: KeyPath, raw: Data) -> WiredAxis:
        """One axis: its common keys, its bus, its driver's keys, and a unique address."""
        common = self._validated(AxisDescription, _contid_keys(raw, AXIS_KEYS), at)
        bus = raw.get("bus") if isinstance(raw, dict) else None
        if not isinstance(bus, str) or not isinstance(raw, dict):
            return WiredAxis(at, common, None)
        if bus not in self.axes:
            message = f"bus: no bus {bus!r}; {allowed_names(self.axes, bus)}"
            self.findings.append(self.document.at_value((*at, "bus"), message))
        driver = self.drivers.get(bus)
        if driver is None:
            return WiredAxis(at, common, None)
        options = self._validated(driver.axis_options, _driver_keys(raw, AXIS_KEYS), at, AXIS_KEYS)
        if options is None:
            return WiredAxis(at, common, None)
        owner = f"{at[1]}.{at[3]}"
        address = driver.address(options)
        # "" when axes of this driver need no address.
        first = self.addresses.setdefault((bus, address), owner) if address else owner
        if first != owner:
            message = f"{address} on bus {bus!r} already belongs to {first}"
            self.findings.append(self.document.at_value((*at, address.partition(" ")[0]), message))
        self.axes[bus].append((owner, options))
        rate = driver.device_rate(options) if isinstance(driver, LimitsRate) and not self.recorded else None
        return WiredAxis(at, common, driver.kind(options), rate)


def robot_classes() -> dict[str, type[RobotDescription]]:
    """Every kind of robot of contid by the value of its key ``model``; see `model_plugins` for others."""
    union = get_args(AnyRobot)[0]
    classes: tuple[type[RobotDescription], ...] = get_args(union) or (union,)
    return {get_args(each.model_fields["model"].annotation)[0]: each for each in classes}


def _mapping(data: Data) -> dict[str, Data]:
    return data if isinstance(data, dict) else {}


def _contid_keys(data: Data, keys: Sequence[str]) -> Data:
    """The keys of a mapping that belong to contid; other data unchanged."""
    return {key: data[key] for key in keys if key in data} if isinstance(data, dict) else data


def _driver_keys(data: dict[str, Data], keys: Sequence[str]) -> Data:
    """The keys of a mapping that belong to the driver."""
    return {key: value for key, value in data.items() if key not in keys}


_Model = TypeVar("_Model", bound=BaseModel)
#: A replaced value can cause the next error.
_ROUNDS: Final = 4


def recover(kind: type[_Model], data: Data) -> _Model | None:
    """``data`` as a ``kind`` with every invalid value dropped or replaced; None when that fails."""
    data = copy.deepcopy(data)
    for _ in range(_ROUNDS):
        try:
            return kind.model_validate_json(json.dumps(data), strict=True)
        except ValidationError as error:
            for detail in error.errors(include_url=False):
                _replace(data, detail["loc"], detail["type"], detail.get("ctx", {}))
    return None


def _replace(data: Data, location: tuple[str | int, ...], kind: str, context: dict[str, object]) -> None:
    table, parent = None, data
    for step in location[:-1]:
        # A location also holds the tags of unions; those are no steps.
        below = step_into(parent, step)
        table, parent = (parent, below[0]) if below else (table, parent)
    key = location[-1] if location else None
    if isinstance(table, list) and isinstance(parent, list):
        table[:] = [row for row in table if row is not parent]
    elif isinstance(parent, list) and isinstance(key, int):
        if kind in ("float_type", "finite_number") and len(parent) > 1:
            parent[key] = parent[key - 1] if key else parent[1]
        else:
            parent[key:] = [0.0] if kind in ("missing", "float_type", "finite_number") else []
    elif isinstance(parent, dict) and isinstance(key, str):
        bound = context.get("gt", context.get("ge", context.get("lt", context.get("le"))))
        if kind == "missing" or (kind in ("float_type", "finite_number") and key in parent):
            parent[key] = 1.0
        elif isinstance(bound, (int, float)) and key in parent:
            parent[key] = bound + (1.0 if "gt" in context else -1.0 if "lt" in context else 0.0)
        elif kind == "value_error" and isinstance(parent.get(key), list):
            parent[key] = _increasing(parent[key])
        else:
            parent.pop(key, None)


def _increasing(data: Data) -> Data:
    """The numbers of a list in rising order; other data unchanged."""
    if not isinstance(data, list):
        return data
    numbers: list[float] = sorted(item for item in data if isinstance(item, (int, float)))
    return [*numbers]
