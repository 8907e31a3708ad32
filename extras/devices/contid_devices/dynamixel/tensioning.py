"""Homing of tendons: all spools of a robot wind in with low current until every tendon carries it.

A jig holds the robot straight: the friction of a gear hides differences of tension that bend a thin backbone.
Axes with ``homing: {method: tension}`` are homed together, so that no tendon alone pushes the robot against
the jig: current-based position mode with a small Goal Current, a slow profile, armed Bus Watchdogs, goals far
beyond the taut position. Once all are taut they back off and wind in once more, slowly, because the speed of
a spool adds to the tension. The zeros are where all servos stand still with the current at the same time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Final

from contid.errors import DeviceError
from contid.hal import Homed, Report
from contid_devices.dynamixel import search
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel import turns
from contid_drivers.dynamixel.axis import KNOWN_TURNS, Axis
from contid_drivers.dynamixel.client import ServoClient
from contid_drivers.dynamixel.options import DynamixelBusOptions, Tensioning

#: A servo stands still when its position changes by less than `search.STILL_TICKS` for this time.
STILL_S: Final = 0.3
#: Share of the current from which on a tendon carries it.
CARRIED: Final = 0.8
#: Way back between the two windings, and the share of the speed of the second winding.
BACK_DEG: Final = 6.0
SLOWLY: Final = 0.1


def tension(
    client: ServoClient, axes: Sequence[Axis], options: DynamixelBusOptions, report: Report
) -> list[Homed]:
    """Zeros of the axes, which stay under torque; the caller switches it off.

    Raises:
        DeviceError: a tendon stays slack or is snapped, a hardware error, a tripped watchdog.
    """
    starts = {}
    for axis in axes:
        homing = _homing(axis)
        starts[axis.device] = search.prepare(client, axis, homing.speed_deg_s, homing.current_ma)
    search.arm(client, axes, options.watchdog_ms)
    report(f"{', '.join(axis.name for axis in axes)}: winding in")
    _wind(client, axes, starts, 1.0)
    first = _until_taut(client, axes, starts)
    back = round(BACK_DEG * reg.TICKS_PER_DEG)
    backs = {axis.device: first[axis.device] - _homing(axis).direction * back for axis in axes}
    search.move_back(client, axes, first, backs)
    _wind(client, axes, starts, SLOWLY)
    found = _until_taut(client, axes, starts)
    for axis in axes:
        name, value = client.name(axis.device), axis.to_rad(found[axis.device])
        axis.reference.require_repetition(name, axis.to_rad(first[axis.device]), value)
        report(f"{axis.name}: taut at {math.degrees(value):.2f} deg")
        axis.reference.require_former(name, value, turns_lost=axis.turn not in KNOWN_TURNS)
    homed = []
    for axis in axes:
        homing, value = _homing(axis), axis.to_rad(found[axis.device])
        wound_deg = abs(found[axis.device] - starts[axis.device]) / reg.TICKS_PER_DEG
        turns.store(client, axis, axis.turns)
        how = f"tension with {homing.current_ma} mA after {wound_deg:.0f} deg"
        homed.append(Homed(axis.name, value, homing.at_mm, how))
    return homed


def _homing(axis: Axis) -> Tensioning:
    homing = axis.options.homing
    assert isinstance(homing, Tensioning)
    return homing


def _wind(client: ServoClient, axes: Sequence[Axis], starts: dict[int, int], share: float) -> None:
    """Set goals twice the allowed slack away, in the winding direction, at a share of the speed."""
    for axis in axes:
        homing = _homing(axis)
        speed = max(1, round(share * homing.speed_deg_s / reg.DEG_S_PER_UNIT))
        client.write(axis.device, reg.PROFILE_VELOCITY, speed)
        reach = round(2.0 * homing.slack_deg * reg.TICKS_PER_DEG)
        client.write(axis.device, reg.GOAL_POSITION, starts[axis.device] + homing.direction * reach)


def _until_taut(client: ServoClient, axes: Sequence[Axis], starts: dict[int, int]) -> dict[int, int]:
    """Wait until all servos stand still with their current; returns their positions [ticks]."""
    until = time.monotonic() + max(_homing(axis).timeout_s for axis in axes)
    last, still_since = dict(starts), time.monotonic()
    while True:
        time.sleep(search.POLL_S)
        slack = []
        for axis in axes:
            device, homing = axis.device, _homing(axis)
            position, current = search.observe(client, axis)
            carried = current >= CARRIED * homing.current_ma
            wound_deg = homing.direction * (position - starts[device]) / reg.TICKS_PER_DEG
            if not carried and wound_deg > homing.slack_deg:
                raise DeviceError(
                    client.name(device),
                    f"slack or snapped tendon: {wound_deg:.0f} deg wound in with {current:.0f} of "
                    f"{homing.current_ma} mA, limit {homing.slack_deg:g} deg",
                    "check the tendon, and direction and slack_deg of its homing",
                )
            if abs(position - last[device]) >= search.STILL_TICKS or not carried:
                still_since, last[device] = time.monotonic(), position
                slack.append(axis.name)
        now = time.monotonic()
        if now - still_since >= STILL_S and not slack:
            return last
        if now > until:
            raise DeviceError(
                client.name(axes[0].device),
                f"no tension within the time limit: {', '.join(slack) or 'tendons'} still move or are slack",
                "check direction, speed and current of the homing",
            )
