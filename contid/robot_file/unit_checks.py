"""Keys whose unit follows the quantity of the axes: rates, rest pose and extra axes of a robot."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Final

from contid.errors import Located
from contid.hal import DeviceRate
from contid.robot_file.axis_names import axis_name_mistake
from contid.robot_file.base import AxisDescription, Quantity
from contid.robot_file.positions import Document, KeyPath
from contid.robot_file.robot import RobotDescription
from contid.units import BAR, DEG, MM_PER_M

#: A device that limits its acceleration needs this times that of its commands, to catch up with them: with
#: 4 % more the set-point of a board runs up to 10 mm past violent commands, with 26 % more 0.5 mm.
CATCH_UP: Final = 1.2
#: Steps of its encoder that the limits of a length have at least: shipped robots have 1100 to 39 000, and
#: metres for millimetres on one side are a thousandth of that.
LEAST_STEPS: Final = 20.0


def check_units(document: Document, at: KeyPath, robot: RobotDescription) -> Iterator[Located]:
    """Check that rates, rest pose and extra axes are written in the unit of the robot's axes, and fit it."""
    unit = robot.quantity.unit
    other = "bar" if unit == "mm" else "mm"
    for key in ("rest", "extra", "follow"):
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
        angle = f"{what}_deg_{per}"
        if robot.extra_deg and getattr(robot.rates, angle) is None:
            names = ", ".join(robot.extra_deg)
            yield document.at_key((*at, "rates"), f"key {angle!r} is missing; {names} of extra_deg needs it")
        elif not robot.extra_deg and getattr(robot.rates, angle) is not None:
            message = f"{angle} has no meaning here: this robot has no extra_deg"
            yield document.at_key((*at, "rates", angle), message)


def check_device_rates(
    document: Document,
    at: KeyPath,
    robot: RobotDescription,
    limited: Mapping[str, tuple[AxisDescription, DeviceRate]],
) -> Iterator[Located]:
    """Check that no device is commanded faster than it follows, at the robot's greatest rates, or farther.

    ``limited`` has the axes whose devices have a limit. Axes with a table (``mm_to_bar``) are not checked.
    """
    own = len(robot.axis_names)
    shares = [sum(map(abs, row)) for row in robot.coupling or ()] or [1.0] * own
    shares += [1.0] * (len(robot.all_axis_names) - own)
    axes = zip(robot.all_axis_names, robot.quantities, shares, robot.driven_limits, strict=True)
    for name, quantity, share, ends in axes:
        if name not in limited:
            continue
        axis, limit = limited[name]
        yield from _check_turns(document, (*at, "axes", name), axis, limit, ends)
        size, shown = (BAR, "bar") if quantity is Quantity.PRESSURE else (DEG, "deg")
        if quantity is Quantity.LENGTH:
            if axis.mm_per_rev is None:
                continue
            share *= 2.0 * math.pi * MM_PER_M / axis.mm_per_rev
        for what, per, key, most, reserve in (
            ("velocity", "s", limit.key, limit.value, 1.0),
            ("acceleration", "s2", limit.acceleration_key, limit.acceleration, CATCH_UP),
        ):
            rate_key = f"{what}_{quantity.unit}_{per}"
            rate: float | None = getattr(robot.rates, rate_key)
            needed = 0.0 if rate is None else quantity.to_si(rate) * share * reserve
            if needed > most * (1.0 + 1e-9):
                named = limit.what if limit.what and key == limit.key else f"{key} is"
                message = (
                    f"{named} {most / size:.4g} {shown}/{per}, but rates.{rate_key} "
                    f"{rate:g} needs {needed / size:.4g}: the device would follow late"
                )
                yield document.at_value((*at, "axes", name, key), message)


def _check_turns(
    document: Document, at: KeyPath, axis: AxisDescription, device: DeviceRate, ends: tuple[float, float]
) -> Iterator[Located]:
    """Check that a device turns as far as the limits of its axis, and that they are many of its steps."""
    gain = math.tau * MM_PER_M / axis.mm_per_rev if axis.mm_per_rev else 1.0
    zero, most = axis.zero_deg, device.reach / DEG
    farthest = max((zero + axis.direction * end * gain / DEG for end in ends), key=abs)
    steps = (ends[1] - ends[0]) * gain / device.step if device.step and axis.mm_per_rev else 0.0
    what = ""
    if most < abs(farthest) < math.inf:
        what = f"turn its device to {farthest:.4g} deg; allowed: at most {most:.5g} deg to either side"
    elif 0.0 < steps < LEAST_STEPS:
        what = f"are {steps:.2g} steps of its device's encoder; allowed: at least {LEAST_STEPS:g}"
    if what:
        key = "mm_per_rev" if axis.mm_per_rev and abs(zero) <= most else "zero_deg"
        yield document.at_value((*at, key), f"the limits of {at[-1]} {what}: see their units")


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
    linear = f"extra_{robot.quantity.unit}"
    others = getattr(robot, linear)
    # Recordings have underscores for the dots.
    own = {*robot.axis_names, *(name.replace(".", "_") for name in robot.axis_names)}
    keyed = [*((linear, name) for name in others), *(("extra_deg", name) for name in robot.extra_deg)]
    for key, name in keyed:
        if key == "extra_deg" and name in others:
            message = f"extra_deg: {name!r} is in {linear} too; an axis has one unit"
        elif name in own:
            message = f"{key}: {name!r} is an axis of the model; choose another name"
        elif mistake := axis_name_mistake(name):
            message = f"{key}: {mistake}"
        else:
            continue
        yield document.at_key((*at, key, name), message)
