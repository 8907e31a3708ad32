"""The report of ``contid check``: contents of a robot file as plain data."""

from __future__ import annotations

import math
from typing import Final, TypedDict

from contid.entry_points import CHECKS, load_all
from contid.errors import ContidError
from contid.hal import load_driver
from contid.robot_file.chain import Chain
from contid.robot_file.document import BusWiring, Isolation
from contid.robot_file.gravity import weight_line
from contid.robot_file.load import LoadedFile
from contid.robot_file.robot import RobotDescription
from contid.robot_file.tick_rate import exchange_time, highest_rate_hz, rate_finding, watchdog_s

_ON: Final = "they go on to their last goal: give them a relay that drops out"
#: What follows from devices without a watchdog.
_UNWATCHED: Final = {
    Isolation.PROCESS: "its devices have no watchdog: if contid crashes, the process of the bus applies "
    f"stop.on_host_loss, but if the computer fails {_ON}",
    Isolation.THREAD: f"its devices have no watchdog: if contid crashes or the computer fails {_ON}",
}


class AxisReport(TypedDict):
    """One axis: its limits in the unit of its robot, its bus and its address."""

    name: str
    unit: str
    min: float
    max: float
    bus: str
    device: str
    address: str


class ArmReport(TypedDict):
    """An arm of a chain and the position of its base."""

    name: str
    base_mm: list[float]


class ChainReport(TypedDict):
    """Two arms and their rope; ``mass_g`` is None when left out."""

    arms: list[ArmReport]
    bases_apart_mm: float
    length_mm: float
    mass_g: float | None
    ends: str
    pieces: int
    floor_mm: float


class RobotReport(TypedDict):
    """One robot; ``limits`` are of every axis, in ``unit`` and seconds."""

    name: str
    model: str
    kinematics: str
    unit: str
    passive: bool
    accepts: list[str]
    base_mm: list[float]
    weight: str
    shape: str
    feedback: str
    velocity: float | None
    acceleration: float | None
    jerk: float | None
    axes: list[AxisReport]
    stop: dict[str, str]
    placeholders: list[str]
    chain: ChainReport | None


class BusReport(TypedDict):
    """One bus; ``highest_rate_hz`` is None where its driver does not compute it.

    ``unwatched`` is what follows from devices without a watchdog, "" where they have one.
    """

    name: str
    driver: str
    port: str
    axes: int
    tolerance_ticks: int
    highest_rate_hz: float | None
    exchange: str
    unwatched: str


class FileReport(TypedDict):
    """The whole file."""

    file: str
    name: str
    rate_hz: float
    robots: list[RobotReport]
    buses: list[BusReport]


def summarise(loaded: LoadedFile) -> FileReport:
    """The report of a file that passed every check."""
    return {
        "file": str(loaded.path),
        "name": loaded.file.name,
        "rate_hz": loaded.file.rate_hz,
        "robots": [_robot(loaded, name, robot) for name, robot in loaded.file.robots.items()],
        "buses": [_bus(bus, loaded.file.rate_hz) for bus in loaded.buses.values()],
    }


def feedback_line(loaded: LoadedFile, name: str) -> str:
    """What extras find about the tip feedback of a robot, for ``contid check``; empty without feedback.

    Raises:
        ContidError: its body would swing ever more.
    """
    robot = loaded.file.robots[name]
    if robot.feedback is None:
        return ""
    try:
        return " ".join(line for each in load_all(CHECKS).values() if (line := each(robot)))
    except ContidError as error:
        raise ContidError(f"{loaded.path}: robots.{name}.feedback: {error}") from error


def _shape(robot: RobotDescription) -> str:
    """What input shaping does, for ``contid check``; empty without."""
    shape = robot.rates.shape
    if shape is None:
        return ""
    least_s, most_s = shape.later_s()
    at, later = f"at {shape.frequency_hz:g} Hz", f"{least_s:.2f} s"
    if shape.schedule is not None:
        at = f"over poses, {shape.schedule.least_hz:g} to {shape.schedule.most_hz:g} Hz"
        later = f"{least_s:.2f} to {most_s:.2f} s"
    low, high = (100.0 * shape.swing_left(off) for off in (0.8, 1.2))
    return (
        f"{shape.kind.value} {at}; motions end {later} later; of a swing 20 % slower {low:.0f} % is left, "
        f"of one 20 % faster {high:.0f} %"
    )


def _robot(loaded: LoadedFile, name: str, robot: RobotDescription) -> RobotReport:
    sides = dict(zip(robot.axis_names, zip(robot.lower, robot.upper, strict=True), strict=True))
    sides |= robot.extra_limits
    quantities = dict(zip(robot.all_axis_names, robot.quantities, strict=True))
    axes: list[AxisReport] = []
    for axis, description in robot.axes.items():
        bus = loaded.buses[description.bus]
        options = dict(bus.axes)[f"{name}.{axis}"]
        driver = load_driver(bus.driver)
        lowest, highest = map(quantities[axis].from_si, sides[axis])
        axes.append(
            {
                "name": axis,
                "unit": quantities[axis].unit,
                "min": _rounded(lowest),
                "max": _rounded(highest),
                "bus": bus.name,
                "device": driver.kind(options).value,
                "address": driver.address(options),
            }
        )
    unit = robot.quantity.unit
    return {
        "name": name,
        "model": robot.model,
        "kinematics": robot.kinematics,
        "unit": unit,
        "passive": robot.passive,
        "accepts": sorted(robot.accepts),
        "base_mm": _base_mm(robot),
        "weight": weight_line(robot),
        "shape": _shape(robot),
        "feedback": feedback_line(loaded, name),
        "velocity": getattr(robot.rates, f"velocity_{unit}_s"),
        "acceleration": getattr(robot.rates, f"acceleration_{unit}_s2"),
        "jerk": getattr(robot.rates, f"jerk_{unit}_s3"),
        "axes": axes,
        "stop": {key: value.value for key, value in robot.stop},
        "placeholders": list(robot.placeholder),
        "chain": _chain(loaded, robot) if isinstance(robot, Chain) else None,
    }


def _chain(loaded: LoadedFile, chain: Chain) -> ChainReport:
    arms: list[ArmReport] = [
        {"name": name, "base_mm": _base_mm(loaded.file.robots[name])} for name in chain.arms
    ]
    rope = chain.rope
    return {
        "arms": arms,
        "bases_apart_mm": math.dist(*(arm["base_mm"] for arm in arms)),
        "length_mm": rope.length_mm,
        "mass_g": rope.mass_g,
        "ends": rope.ends,
        "pieces": rope.pieces,
        "floor_mm": chain.floor_mm,
    }


def _base_mm(robot: RobotDescription) -> list[float]:
    return [robot.base.x_mm, robot.base.y_mm, robot.base.z_mm]


def _bus(bus: BusWiring, rate_hz: float) -> BusReport:
    time = exchange_time(bus)
    finding = None if time is None else rate_finding(bus.name, time, rate_hz)
    return {
        "name": bus.name,
        "driver": bus.driver,
        # Drivers choose the key; these two are usual.
        "port": str(getattr(bus.options, "port", getattr(bus.options, "address", ""))),
        "axes": len(bus.axes),
        "tolerance_ticks": bus.tolerance_ticks,
        "highest_rate_hz": None if time is None else highest_rate_hz(time),
        "exchange": "; ".join(filter(None, (finding.message, finding.remedy))) if finding else "",
        "unwatched": "" if watchdog_s(bus) else _UNWATCHED[bus.isolation],
    }


def _rounded(value: float) -> float:
    """Rounded to 12 digits: the conversion through SI costs the last bit."""
    return float(f"{value:.12g}")
