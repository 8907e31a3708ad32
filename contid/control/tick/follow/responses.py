"""The response of every axis of a robot, in the unit of its device, from the robot file and the drivers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from contid.control.tick.follow.expected_range import AxisResponse
from contid.control.tick.transmission import RobotTransmission
from contid.hal import RESPONSES, DeviceKind, DeviceResponse
from contid.robot_file.base import Quantity
from contid.robot_file.robot import RobotDescription
from contid.units import BAR

#: Share of its greatest effort with which a device that yields pushes on something.
PUSHING: Final = 0.3
#: Change of a reading that noise, wear or a late adapter may add to the fastest motion [rad or Pa].
_JUMP_SLACK: Final = {False: 0.5, True: 0.3 * BAR}


def axis_responses(
    robot: RobotDescription,
    transmission: RobotTransmission,
    devices: Mapping[str, DeviceResponse],
    period_s: float,
) -> tuple[AxisResponse, ...]:
    """The response of every axis, in the order of the axes.

    Args:
        robot: its description; ``follow_delay_ms`` and ``follow_lag_ms`` of an axis, else of the robot,
            replace those of the device.
        transmission: of its axes.
        devices: response of the device of each axis by its name in the robot; by its quantity where missing.
        period_s: of the tick.
    """
    out = []
    ends = zip(transmission.travel(), robot.driven_limits, strict=True)
    for name, quantity, (device_ends, driven_ends) in zip(
        robot.all_axis_names, robot.quantities, ends, strict=True
    ):
        device = devices.get(name, _of_quantity(quantity))
        pressure = quantity is Quantity.PRESSURE or robot.axes[name].mm_to_bar is not None
        unit = _span(driven_ends) / _span(device_ends) if robot.axes[name].mm_to_bar else _gain(robot, name)
        delay_ms, lag_ms = (
            getattr(robot if getattr(robot.axes[name], key) is None else robot.axes[name], key)
            for key in ("follow_delay_ms", "follow_lag_ms")
        )
        out.append(
            AxisResponse(
                tolerance=robot.follow_tolerance(quantity) / unit,
                delay_s=device.delay_s if delay_ms is None else delay_ms / 1e3,
                lag_s=device.lag_s if lag_ms is None else lag_ms / 1e3,
                top=device.top,
                jump=device.fastest * period_s + _JUMP_SLACK[pressure],
                overshoot_s=device.overshoot_s,
                unit=unit,
                least_delay_s=robot.axes[name].follow_least_delay_ms / 1e3,
                least_lag_s=robot.axes[name].follow_least_lag_ms / 1e3,
                pushing_a=math.inf if device.effort_limit_a is None else PUSHING * device.effort_limit_a,
            )
        )
    return tuple(out)


def _of_quantity(quantity: Quantity) -> DeviceResponse:
    return RESPONSES[DeviceKind.REGULATOR if quantity is Quantity.PRESSURE else DeviceKind.MOTOR]


def _gain(robot: RobotDescription, name: str) -> float:
    """Size of what an axis drives, per unit of its device."""
    mm_per_rev = robot.axes[name].mm_per_rev
    return 1.0 if mm_per_rev is None else mm_per_rev / (1e3 * math.tau)


def _span(ends: tuple[float, float]) -> float:
    return abs(ends[1] - ends[0])
