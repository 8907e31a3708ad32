"""What builds a bus or a model in its own process, packed: the control process imports nothing of it."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace

from pydantic import BaseModel

from contid.control.engine.wiring import WiredBus, device_response, simulated_bodies, wired_buses
from contid.control.tick.supervisor import REST_OF
from contid.hal import AxisOnBus, Bus, Clock, Rest, SimulatesBodies, load_driver
from contid.hal.isolated import IsolatedAxisOptions, IsolatedBusOptions
from contid.kinematics.isolated_robot import IsolatedRobot
from contid.robot_file.document import Isolation
from contid.robot_file.load import LoadedFile
from contid.robot_file.loader import robot_classes
from contid.robot_file.robot import RobotDescription
from contid.robot_file.tick_rate import watchdog_s


@dataclass(frozen=True, slots=True)
class BusBody:
    """A bus before it is built.

    Attributes:
        name: of the bus.
        driver: name of its driver.
        options: of the bus.
        axes: on it.
        bodies: robots whose bodies a simulated bus computes, by name.
        rests: what axes without a watchdog do when the control process dies, by axis.
    """

    name: str
    driver: str
    options: BaseModel
    axes: tuple[AxisOnBus, ...]
    bodies: dict[str, BaseModel]
    rests: dict[str, Rest]

    def build(self, clock: Clock) -> Bus:
        """The bus; imports its driver and accesses no device."""
        bus = load_driver(self.driver).open_bus(self.name, self.options, self.axes, clock)
        if isinstance(bus, SimulatesBodies):
            for robot, description in self.bodies.items():
                bus.carry(robot, description)
        return bus


def isolated(loaded: LoadedFile) -> LoadedFile:
    """The robot file for the control process: isolated buses and models of others are packed."""
    wired = {each.wiring.name: each for each in wired_buses(loaded)}
    buses = dict(loaded.buses)
    for name, each in wired.items():
        wiring = each.wiring
        if wiring.isolation is Isolation.PROCESS:
            options = IsolatedBusOptions(
                watchdog_ms=1e3 * watchdog_s(wiring) or None, body=pickle.dumps(_body(loaded, each))
            )
            axes = tuple(
                (axis, IsolatedAxisOptions(response=device_response(wiring, own)))
                for axis, own in wiring.axes
            )
            buses[name] = replace(wiring, options=options, axes=axes)
    return with_isolated_models(replace(loaded, buses=buses))


def with_isolated_models(loaded: LoadedFile) -> LoadedFile:
    """The robot file with an `IsolatedRobot` for every robot whose model is not contid's."""
    robots = loaded.file.robots
    isolated = {
        name: IsolatedRobot.of(robot, pickle.dumps(robot))
        for name, robot in robots.items()
        if _is_foreign(robot)
    }
    if not isolated:
        return loaded
    file = loaded.file.model_copy(update={"robots": {**robots, **isolated}})
    return replace(loaded, file=file, known_sha256=loaded.sha256)


def _is_foreign(robot: RobotDescription) -> bool:
    """True for a model of another package.

    A description that derives from one of contid's kinds stays: simulated bodies, sensing and the links of
    chains recognise such a robot by its class, and use it in this process.
    """
    return not isinstance(robot, (IsolatedRobot, *robot_classes().values()))


def _body(loaded: LoadedFile, bus: WiredBus) -> BusBody:
    bodies = {
        name: robot for name, robot, carriers in simulated_bodies(loaded) if carriers == {bus.wiring.name}
    }
    rests = {}
    if not watchdog_s(bus.wiring):
        for axis in bus.axes:
            robot = loaded.file.robots[axis.name.partition(".")[0]]
            rests[axis.name] = REST_OF[robot.stop.on_host_loss]
    return BusBody(bus.wiring.name, bus.wiring.driver, bus.wiring.options, bus.axes, bodies, rests)
