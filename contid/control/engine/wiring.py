"""From a loaded robot file to what runs: buses by their drivers, plans by their models."""

from __future__ import annotations

from collections.abc import Mapping

from contid.control.engine.tick_layout import RecordLayout, RobotLayout
from contid.control.tick.config import RobotConfig, robot_config
from contid.control.tick.preflight import Preflight, Unreachable
from contid.control.tick.transmission import RobotTransmission
from contid.hal import AxisOnBus, Bus, Clock, load_driver
from contid.kinematics.rope.chain import ChainGuard
from contid.robot_file.chain import Chain
from contid.robot_file.load import LoadedFile
from contid.robot_file.robot import RobotDescription


def driven_robots(loaded: LoadedFile) -> Mapping[str, RobotDescription]:
    """Robots with actuators of their own; a passive one only watches, it has no place in the tick."""
    return {name: robot for name, robot in loaded.file.robots.items() if not robot.passive}


def open_buses(loaded: LoadedFile, clock: Clock) -> Mapping[str, Bus]:
    """Build and open every bus of a robot file that carries an axis.

    Raises:
        DeviceNotFoundError: one could not be opened; those opened before it are closed again.
    """
    buses = build_buses(loaded, clock)
    try:
        for bus in buses.values():
            bus.open()
    except BaseException:
        for bus in buses.values():
            bus.close()
        raise
    return buses


def build_buses(loaded: LoadedFile, clock: Clock) -> dict[str, Bus]:
    """Every bus that carries an axis; no device is touched yet."""
    travel: dict[str, tuple[float, float]] = {}
    for name, robot in driven_robots(loaded).items():
        ranges = RobotTransmission(robot).travel()
        travel |= {f"{name}.{axis}": ends for axis, ends in zip(robot.all_axis_names, ranges, strict=True)}
    buses = {}
    for wiring in loaded.buses.values():
        if not wiring.axes:
            continue
        axes = [AxisOnBus(axis, options, travel.get(axis)) for axis, options in wiring.axes]
        buses[wiring.name] = load_driver(wiring.driver).open_bus(wiring.name, wiring.options, axes, clock)
    return buses


def build_robot_configs(loaded: LoadedFile, rate_hz: float) -> tuple[RobotConfig, ...]:
    """One plan per driven robot, in file order."""
    tolerance = {bus.name: bus.tolerance_ticks for bus in loaded.buses.values()}
    return tuple(
        robot_config(name, robot, RobotTransmission(robot), rate_hz, tolerance)
        for name, robot in driven_robots(loaded).items()
    )


def chain_guards(loaded: LoadedFile) -> list[ChainGuard]:
    """The guards of the closed chains of a file."""
    robots = loaded.file.robots.items()
    return [ChainGuard(name, robot) for name, robot in robots if isinstance(robot, Chain)]


def build_preflight(loaded: LoadedFile, rate_hz: float, unreachable: Unreachable) -> Preflight | None:
    """What rows must pass; None when nearest points will do and no chain watches."""
    guards = chain_guards(loaded)
    if unreachable is Unreachable.NEAREST and not guards:
        return None
    return Preflight(build_robot_configs(loaded, rate_hz), guards, unreachable)


def record_layout(loaded: LoadedFile, rate_hz: float) -> RecordLayout:
    """Where everything of these robots lies in a record."""
    robots = tuple(
        RobotLayout(name, robot.model, robot.quantity.unit, robot.all_axis_names)
        for name, robot in driven_robots(loaded).items()
    )
    return RecordLayout(loaded.file.name, rate_hz, robots)
