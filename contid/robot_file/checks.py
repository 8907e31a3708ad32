"""Checks that involve several keys of a robot."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, get_args

from pydantic import BaseModel

from contid.errors import Located
from contid.hal import DeviceKind, DeviceRate
from contid.robot_file.base import AxisDescription, Quantity, StopPolicy
from contid.robot_file.findings import allowed_names
from contid.robot_file.gravity import check_down
from contid.robot_file.positions import Data, Document, KeyPath
from contid.robot_file.robot import RobotDescription
from contid.robot_file.tendon.robot import TendonRobot
from contid.robot_file.unit_checks import check_device_rates, check_units

#: Prefixes of trajectory columns that are not names of robots.
RESERVED_NAMES: Final = ("t_s", "mid", "load", "meas")
_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")


@dataclass(frozen=True, slots=True)
class WiredAxis:
    """One axis of a robot, as far as it is valid.

    Attributes:
        at: its place in the document.
        description: its common keys, None when invalid.
        kind: its actuator, None when its bus or driver is invalid.
        rate: what its device follows, None when the driver has no such limit.
    """

    at: KeyPath
    description: AxisDescription | None
    kind: DeviceKind | None
    rate: DeviceRate | None = None


def check_name(document: Document, at: KeyPath) -> Iterator[Located]:
    """Check a robot's or bus's name, which becomes part of column names and messages."""
    name = str(at[-1])
    if not _NAME.fullmatch(name):
        message = f"name {name!r}: allowed are letters, digits, _ and -, beginning with a letter"
        yield document.at_key(at, message)
    if at[0] == "robots" and name in RESERVED_NAMES:
        yield document.at_key(at, f"name {name!r} is reserved in trajectory columns; choose another")


def check_robot(
    document: Document, at: KeyPath, robot: RobotDescription, wired: Mapping[str, WiredAxis]
) -> Iterator[Located]:
    """Check the keys of one robot against each other, beyond the validators of its class."""
    yield from _check_axes(document, at, robot, wired)
    if robot.passive:
        yield from _check_passive(document, at, robot)
        return
    yield from _check_plane(document, at, robot)
    yield from check_units(document, at, robot)
    yield from check_down(document, at, robot)
    limited = {
        name: (axis.description, axis.rate)
        for name, axis in wired.items()
        if axis.description is not None and axis.rate is not None
    }
    yield from check_device_rates(document, at, robot, limited)
    yield from _check_stops(document, at, robot, wired)
    for index, key in enumerate(robot.placeholder):
        if not _is_key(document, at, robot, key):
            example = f"geometry.{_example(robot)}"
            message = f"placeholder {key!r} names no key of this robot"
            message += f"; write it like {example}" if key != example else ""
            yield document.at_value((*at, "placeholder", index), message)


def _check_axes(
    document: Document, at: KeyPath, robot: RobotDescription, wired: Mapping[str, WiredAxis]
) -> Iterator[Located]:
    needed = () if robot.passive else robot.all_axis_names
    for name in needed:
        if name not in wired:
            message = f"axis {name!r} is missing; this robot needs {', '.join(needed)}"
            yield document.at_key((*at, "axes"), message)
    fronts = {name.partition(".")[0] for name in robot.axis_names if "." in name}
    if at[-1] in fronts:
        yield document.at_key(at, f"name {at[-1]!r} is also the beginning of an axis name; choose another")
    driven = dict(zip(robot.all_axis_names, robot.driven_limits, strict=True))
    quantities = dict(zip(robot.all_axis_names, robot.quantities, strict=True))
    for name, axis in wired.items():
        if name not in needed:
            what = "a passive robot has no axes" if robot.passive else allowed_names(needed, name)
            yield document.at_key(axis.at, f"this robot has no axis {name!r}; {what}")
        elif isinstance(robot, TendonRobot) and robot.drives and _winds_in(document.get(axis.at)):
            message = (
                "homing: method tension winds single tendons in, and a drive moves several; write the zero "
                "of the straight robot as zero_deg, or use another method"
            )
            yield document.at_key((*axis.at, "homing"), message)
        elif axis.description is not None and axis.kind is not None:
            yield from _check_transmission(
                document, axis.at, axis.description, axis.kind, quantities[name], driven.get(name)
            )


def _winds_in(axis: Data) -> bool:
    homing = axis.get("homing") if isinstance(axis, dict) else None
    return isinstance(homing, dict) and homing.get("method") == "tension"


def _check_passive(document: Document, at: KeyPath, robot: RobotDescription) -> Iterator[Located]:
    """Refuse keys that only a robot with actuators can use."""
    common = RobotDescription.model_fields.keys() - {"model", "axes", "placeholder"}
    for key in sorted(robot.model_fields_set & common):
        message = f"{key} has no meaning here: {at[-1]!r} has no actuators of its own"
        yield document.at_key((*at, key), message)


def _check_transmission(
    document: Document,
    at: KeyPath,
    axis: AxisDescription,
    kind: DeviceKind,
    quantity: Quantity,
    driven: tuple[float, float] | None,
) -> Iterator[Located]:
    """Check that the transmission fits the device; see `AxisDescription`."""
    regulator = kind is DeviceKind.REGULATOR
    fitting = None
    if quantity is Quantity.LENGTH:
        fitting = "mm_to_bar" if regulator else "mm_per_rev"
    elif quantity is Quantity.ANGLE and regulator:
        yield document.at_key(
            at, f"axis {at[-1]!r} is an angle, but a {kind} has no angle; use a servo or a motor"
        )
        return
    elif quantity is Quantity.PRESSURE and not regulator:
        yield document.at_key(
            at, f"axis {at[-1]!r} is a pressure, but a {kind} has no pressure; use a regulator"
        )
        return
    for key in ("mm_per_rev", "mm_to_bar"):
        given = getattr(axis, key) is not None
        if key == fitting and not given:
            message = f"{key} is missing: it maps the length of axis {at[-1]!r} to its {kind}"
            yield document.at_key(at, message)
        elif given and key != fitting:
            need = f"write {fitting}" if fitting else f"its {quantity} needs no transmission"
            article = "an" if quantity is Quantity.ANGLE else "a"
            message = f"{key} has no meaning for {article} {quantity} on a {kind}; {need}"
            yield document.at_key((*at, key), message)
    if regulator:
        for key in axis.model_fields_set & {"zero_deg", "direction"}:
            yield document.at_key((*at, key), f"{key} has no meaning on a {kind}")
    if fitting == "mm_to_bar" and axis.mm_to_bar is not None:
        yield from _check_table(document, (*at, "mm_to_bar"), axis.mm_to_bar, driven)


def _check_table(
    document: Document,
    at: KeyPath,
    table: tuple[tuple[float, float], ...],
    driven: tuple[float, float] | None,
) -> Iterator[Located]:
    if len(table) < 2:
        yield document.at_value(at, "mm_to_bar: at least two rows of [length_mm, pressure_bar] are needed")
        return
    rising = table[1][1] > table[0][1]
    for index, (before, here) in enumerate(itertools.pairwise(table), start=1):
        if here[0] <= before[0]:
            yield document.at_value((*at, index), "mm_to_bar: lengths must increase from row to row")
        if here[1] == before[1] or (here[1] > before[1]) is not rising:
            yield document.at_value((*at, index), "mm_to_bar: pressures must always rise or always fall")
    if driven is not None:
        low, high = (value * Quantity.LENGTH.per_si for value in driven)
        slack = 1e-9 * max(abs(low), abs(high), 1.0)  # limits pass through SI and back
        if low < table[0][0] - slack or high > table[-1][0] + slack:
            covered = f"{table[0][0]:g} to {table[-1][0]:g} mm"
            message = f"mm_to_bar covers {covered}, the axis goes from {low:g} to {high:g} mm"
            yield document.at_value(at, message)


def _check_plane(document: Document, at: KeyPath, robot: RobotDescription) -> Iterator[Located]:
    """A planar robot takes x and y of the world, so its plane must be the world's xy plane."""
    if robot.dimension == 2:
        for key in ("roll_deg", "pitch_deg"):
            angle_deg = getattr(robot.base, key)
            if angle_deg % 180.0 != 0.0:
                message = (
                    f"{key} {angle_deg:g} turns a planar robot out of the plane of x and y, "
                    "in which its targets are; allowed: 0 or 180, and any yaw_deg"
                )
                yield document.at_key((*at, "base", key), message)


def _check_stops(
    document: Document, at: KeyPath, robot: RobotDescription, wired: Mapping[str, WiredAxis]
) -> Iterator[Located]:
    """``vent`` needs a regulator, ``relax`` a device with torque. Defaults are checked too."""
    kinds = {axis.kind for axis in wired.values()}
    if None in kinds or not kinds:
        return
    stop: BaseModel = robot.stop
    for key, field in type(stop).model_fields.items():
        policy = getattr(stop, key)
        default = "" if key in stop.model_fields_set else " (the default)"
        place = (*at, "stop", key)
        if policy is StopPolicy.VENT and DeviceKind.REGULATOR not in kinds:
            allowed = [each.value for each in get_args(field.annotation) or StopPolicy if each is not policy]
            message = f"{key}: vent{default} is for pressure regulators and this robot has none; allowed: "
            yield document.at_value(place, message + ", ".join(allowed))
        if policy is StopPolicy.RELAX and kinds == {DeviceKind.REGULATOR}:
            message = f"{key}: relax{default} turns torque off and a regulator has none; write {key}: vent"
            yield document.at_value(place, message)


def _is_key(document: Document, at: KeyPath, robot: RobotDescription, key: str) -> bool:
    """True when a dotted key is written in the robot, or is a top-level key of its class.

    Names of axes contain dots, so every split is tried.
    """
    steps = key.split(".")

    def below(place: KeyPath, rest: list[str]) -> bool:
        if not rest:
            return True
        data = document.get(place)
        if isinstance(data, list):
            return rest[0].isdigit() and int(rest[0]) < len(data) and below((*place, int(rest[0])), rest[1:])
        if not isinstance(data, dict):
            return False
        return any(
            below((*place, ".".join(rest[:count])), rest[count:])
            for count in range(1, len(rest) + 1)
            if ".".join(rest[:count]) in data
        )

    return below(at, steps) or (len(steps) == 1 and key in type(robot).model_fields)


def _example(robot: RobotDescription) -> str:
    geometry = type(robot).model_fields.get("geometry")
    kind = geometry.annotation if geometry is not None else None
    names = list(kind.model_fields) if isinstance(kind, type) and issubclass(kind, BaseModel) else []
    return names[0] if names else "KEY"
