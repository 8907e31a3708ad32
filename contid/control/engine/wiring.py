"""Builds buses, robot configurations and checks from a loaded robot file."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from contid.control.engine.stages import BodyClearance, ChainGuards
from contid.control.engine.tick_layout import RecordLayout, RobotLayout
from contid.control.tick.config import RobotConfig, robot_config
from contid.control.tick.preflight.kept_apart import ChecksRope
from contid.control.tick.preflight.rows import Preflight, Unreachable
from contid.control.tick.transmission import RobotTransmission
from contid.errors import ContidError, DriverDefectError
from contid.hal import (
    RESPONSES,
    AxisOnBus,
    Bus,
    Clock,
    DeviceResponse,
    Driver,
    Responds,
    SimulatesBodies,
    SpooledTendon,
    find_tool,
    load_driver,
)
from contid.hal.isolated import IsolatedAxisOptions, IsolatedBusOptions
from contid.kinematics.tendon.described import spooled_tendons
from contid.robot_file.chain import Chain
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.document import BusWiring
from contid.robot_file.load import LoadedFile
from contid.robot_file.needs import load_chains, load_clearance
from contid.robot_file.proven.bringup import changed_axes, slow_notice
from contid.robot_file.rack_finger import RackFinger
from contid.robot_file.tendon.robot import TendonRobot
from contid.robot_file.tick_rate import watchdog_s

if TYPE_CHECKING:
    from pydantic import BaseModel

log = logging.getLogger(__name__)

_Tool = TypeVar("_Tool")


@dataclass(frozen=True, slots=True)
class WiredBus:
    """One bus with axes, and its driver."""

    wiring: BusWiring
    driver: Driver
    axes: tuple[AxisOnBus, ...]

    def tool(self, interface: type[_Tool]) -> _Tool | None:
        """The object with an optional interface of `contid.hal` for its driver; None where nothing has it."""
        return find_tool(self.wiring.driver, self.driver, interface)

    def capable(self, interface: type[_Tool], command: str) -> _Tool:
        """The same, for a command that needs it.

        Raises:
            ContidError: nothing has it.
        """
        found = self.tool(interface)
        if found is None:
            name = self.wiring.driver
            raise ContidError(f"bus {self.wiring.name}: driver {name!r} cannot `contid {command}`")
        return found


def wired_buses(loaded: LoadedFile) -> list[WiredBus]:
    """Every bus that carries an axis, in file order."""
    travel: dict[str, tuple[float, float]] = {}
    tendons: dict[str, SpooledTendon] = {}
    for name, robot in loaded.driven.items():
        transmission = RobotTransmission(robot)
        ranges = transmission.travel()
        travel |= {f"{name}.{axis}": ends for axis, ends in zip(robot.all_axis_names, ranges, strict=True)}
        if isinstance(robot, TendonRobot):
            found = spooled_tendons(robot, transmission.to_device)
            tendons |= {f"{name}.{axis}": each for axis, each in zip(robot.axis_names, found, strict=False)}
    buses = []
    for wiring in loaded.buses.values():
        if not wiring.axes or isinstance(wiring.options, IsolatedBusOptions):
            continue
        axes = tuple(
            AxisOnBus(axis, options, travel.get(axis), tendons.get(axis)) for axis, options in wiring.axes
        )
        buses.append(WiredBus(wiring, load_driver(wiring.driver), axes))
    return buses


def open_buses(loaded: LoadedFile, clock: Clock) -> Mapping[str, Bus]:
    """Build and open every bus of a robot file that carries an axis and has no process of its own.

    Raises:
        DeviceNotFoundError: one could not be opened; the others are closed again.
    """
    for axis, change in changed_axes(loaded).items():
        log.warning("%s: %s; %s", axis, change, slow_notice(axis))
    buses = build_buses(loaded, clock)
    try:
        for name, bus in buses.items():
            with as_bus_error(loaded.buses[name]):
                bus.open()
    except BaseException:
        for bus in buses.values():
            with suppress(Exception):
                bus.close()
        raise
    return buses


@contextmanager
def as_bus_error(wiring: BusWiring) -> Iterator[None]:
    """Raise a defect of the driver of a bus as an error of that bus."""
    try:
        yield
    except ContidError:
        raise
    except (Exception, SystemExit) as error:
        text = f"bus {wiring.name}: driver {wiring.driver!r}: {type(error).__name__}: {error}"
        raise DriverDefectError(text) from error


def build_buses(loaded: LoadedFile, clock: Clock) -> dict[str, Bus]:
    """Every bus that carries an axis; accesses no device."""
    buses = {}
    for each in wired_buses(loaded):
        with as_bus_error(each.wiring):
            name = each.wiring.name
            buses[name] = each.driver.open_bus(name, each.wiring.options, each.axes, clock)
    for name, robot, carriers in simulated_bodies(loaded):
        simulated = [buses[each] for each in carriers if isinstance(buses.get(each), SimulatesBodies)]
        if simulated and len(carriers) > 1:
            listed = ", ".join(sorted(carriers))
            raise ContidError(
                f"{loaded.path}: robots.{name}.sim: its axes are on {listed}; they must be on one bus"
            )
        for bus in simulated:
            assert isinstance(bus, SimulatesBodies)
            bus.carry(name, robot)
    return buses


def simulated_bodies(loaded: LoadedFile) -> Iterator[tuple[str, BaseModel, set[str]]]:
    """Robots whose bodies a simulated bus computes, by name, and the buses of their axes."""
    for name, robot in loaded.driven.items():
        if isinstance(robot, Cosserat | RackFinger | TendonRobot) and robot.sim is not None:
            yield name, robot, {robot.axes[axis].bus for axis in robot.axis_names}


def build_robot_configs(loaded: LoadedFile, rate_hz: float) -> tuple[RobotConfig, ...]:
    """One configuration per driven robot, in file order; redundant ones keep away from obstacles."""
    tolerance = {bus.name: bus.tolerance_ticks for bus in loaded.buses.values()}
    watchdogs_s = {bus.name: watchdog_s(bus) for bus in loaded.buses.values()}
    responses = {
        axis: device_response(wiring, options)
        for wiring in loaded.buses.values()
        for axis, options in wiring.axes
    }
    configs = tuple(
        robot_config(
            name,
            robot,
            RobotTransmission(robot),
            rate_hz,
            tolerance,
            watchdogs_s,
            devices={axis: responses[f"{name}.{axis}"] for axis in robot.all_axis_names},
        )
        for name, robot in loaded.driven.items()
    )
    if loaded.file.clearance is not None and loaded.file.clearance.obstacles:
        load_clearance(loaded).lead(configs, loaded)
    return configs


def device_response(wiring: BusWiring, axis: BaseModel) -> DeviceResponse:
    """The response of the device of an axis: by its driver, else by its kind."""
    if isinstance(axis, IsolatedAxisOptions):
        return axis.response
    driver = load_driver(wiring.driver)
    if isinstance(driver, Responds):
        return driver.device_response(wiring.options, axis)
    return RESPONSES[driver.kind(axis)]


def chains_of(loaded: LoadedFile) -> ChainGuards | None:
    """The closed chains of a file, None without.

    Raises:
        ContidError: the extra is not installed.
    """
    names = [name for name, robot in loaded.file.robots.items() if isinstance(robot, Chain)]
    if not names:
        return None
    built: ChainGuards = load_chains(loaded, names[0])(loaded)
    return built


def chain_guards(loaded: LoadedFile) -> Sequence[ChecksRope]:
    """The guards of the closed chains of a file."""
    chains = chains_of(loaded)
    return () if chains is None else chains.guards


def clearance_of(loaded: LoadedFile) -> BodyClearance | None:
    """What a file keeps apart, None when it does not state it.

    Raises:
        ContidError: bodies are too near with every robot at its rest pose; the extra is not installed.
    """
    if loaded.file.clearance is None:
        return None
    built: BodyClearance = load_clearance(loaded)(loaded)
    return built


def build_preflight(loaded: LoadedFile, rate_hz: float, unreachable: Unreachable) -> Preflight | None:
    """The check of rows before motion; None when nearest points are allowed and no chain exists.

    Raises:
        ContidError: nearest points are allowed, and bodies are to be kept apart.
    """
    guards, clearance = chain_guards(loaded), clearance_of(loaded)
    if unreachable is Unreachable.NEAREST and clearance is not None:
        raise ContidError(
            f"{loaded.path}: nearest points of targets out of reach are not checked for clearance; "
            "refuse them, or remove clearance: from the file"
        )
    if unreachable is Unreachable.NEAREST and not guards:
        return None
    return Preflight(build_robot_configs(loaded, rate_hz), guards, unreachable, clearance=clearance)


def record_layout(loaded: LoadedFile, rate_hz: float) -> RecordLayout:
    """The layout of a record of these robots."""
    robots = tuple(
        RobotLayout(name, robot.model, robot.quantity.unit, robot.all_axis_names, len(robot.extra_deg))
        for name, robot in loaded.driven.items()
    )
    return RecordLayout(loaded.file.name, rate_hz, robots)
