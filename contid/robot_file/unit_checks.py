"""Keys whose unit follows the quantity of the axes: rates, rest pose and extra axes of a robot."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from contid.errors import Located
from contid.robot_file.positions import Document, KeyPath
from contid.robot_file.robot import RobotDescription

#: An extra axis is a column with its unit; a dot would be a group of columns.
_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
#: Columns of tips.
_TAKEN: Final = frozenset({"x", "y", "z"})


def check_units(document: Document, at: KeyPath, robot: RobotDescription) -> Iterator[Located]:
    """Check that rates, rest pose and extra axes are written in the unit of the robot's axes, and fit it."""
    unit = robot.quantity.unit
    other = "bar" if unit == "mm" else "mm"
    for key in ("rest", "extra"):
        if f"{key}_{other}" in robot.model_fields_set:
            message = (
                f"{key}_{other} has no meaning here: this robot's axes are in {unit}; write {key}_{unit}"
            )
            yield document.at_key((*at, f"{key}_{other}"), message)
    yield from _check_rates(document, at, robot)
    yield from _check_rest(document, at, robot)
    yield from _check_extra(document, at, robot)


def _check_rates(document: Document, at: KeyPath, robot: RobotDescription) -> Iterator[Located]:
    unit = robot.quantity.unit
    for what, per in (("velocity", "s"), ("acceleration", "s2"), ("jerk", "s3")):
        key = f"{what}_{unit}_{per}"
        if getattr(robot.rates, key) is None:
            yield document.at_key((*at, "rates"), f"key {key!r} is missing; this robot's axes are in {unit}")
        other = f"{what}_{'bar' if unit == 'mm' else 'mm'}_{per}"
        if getattr(robot.rates, other) is not None:
            message = f"{other} has no meaning here: this robot's axes are in {unit}; write {key}"
            yield document.at_key((*at, "rates", other), message)


def _check_rest(document: Document, at: KeyPath, robot: RobotDescription) -> Iterator[Located]:
    unit = robot.quantity.unit
    written: tuple[float, ...] | None = getattr(robot, f"rest_{unit}")
    if written is None:
        return
    here = (*at, f"rest_{unit}")
    if len(written) != len(robot.axis_names):
        names = ", ".join(robot.axis_names)
        message = f"rest_{unit} has {len(written)} numbers; allowed: {len(robot.axis_names)}, for {names}"
        yield document.at_value(here, message)
        return
    limits = zip(robot.axis_names, robot.rest, robot.lower, robot.upper, written, strict=True)
    for index, (name, rest, low, high, value) in enumerate(limits):
        if not low <= rest <= high:
            low, high = (robot.quantity.from_si(end) for end in (low, high))
            message = f"rest_{unit}: {value:g} for {name} is outside its limits {low:g} to {high:g} {unit}"
            yield document.at_value((*here, index), message)


def _check_extra(document: Document, at: KeyPath, robot: RobotDescription) -> Iterator[Located]:
    key = f"extra_{robot.quantity.unit}"
    for name in robot.extra_axis_names:
        if name in robot.axis_names:
            message = f"{key}: {name!r} is an axis of the model; choose another name"
        elif not _NAME.fullmatch(name):
            message = f"{key}: name {name!r}: allowed are letters, digits and _, beginning with a letter"
        elif name in _TAKEN:
            message = f"{key}: {name!r} is a coordinate of the tip in trajectory columns; choose another name"
        else:
            continue
        yield document.at_key((*at, key, name), message)
