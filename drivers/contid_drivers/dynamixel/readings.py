"""What a reading of a servo shows: its position, or that it reset, jumped, failed or does not follow.

Positions are in rad on the scale of the servo, currents in A, times in s of the host's clock. A fault is
latched in the axis (`Axis.latch`), which ends its commands.
"""

from __future__ import annotations

import math
from typing import Final

from contid.hal import SLACK_TENDON, SNAPPED_TENDON
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import KNOWN_TURNS, Axis, TorqueState, Turn
from contid_drivers.dynamixel.exchange.block import ServoReading
from contid_drivers.dynamixel.plausibility import FAR_RAD, has_jumped

#: Difference of the time of the servo from that of the host, of readings that came late, and of its clock.
TICK_SLACK_MS: Final = 50.0
TICK_SLACK: Final = 0.05
TORQUE_OFF_FAULT: Final = "its torque was switched off from outside: does another program use this bus?"
UNREAD_ALERT: Final = "hardware error: alert, cause not read yet"
_JUMP: Final = "another program reset its count of turns, or its encoder is faulty"


def may_be_after_reset(axis: Axis, reading: ServoReading, angle: float, time_s: float) -> bool:
    """Whether nothing in a reading, with its angle [rad], excludes a reset since the one before.

    A reset clears the mapping and the watchdog, which `take` and `detect_reported` see, and sets the time of
    the servo to 0; a reset that happens to fit that time missed exchanges. A long way may be whole turns.
    """
    if axis.turn is not Turn.IN_SERVO:
        return False
    if axis.seen is not None and abs(angle - axis.seen) > FAR_RAD:
        return reading.voltage_low != 0
    if axis.watchdog_units or reading.voltage_low is not None:
        return False
    if axis.misses or axis.tick is None or reading.tick is None:
        return True
    elapsed_ms = 1e3 * (time_s - axis.time_s)
    late_ms = math.remainder(reading.tick - axis.tick - elapsed_ms, reg.REALTIME_TICKS)
    return abs(late_ms) > TICK_SLACK_MS + TICK_SLACK * elapsed_ms


def take(axis: Axis, reading: ServoReading, angle: float, time_s: float) -> None:
    """Store an answer with its angle [rad] that arrived at ``time_s``, and detect faults."""
    if reading.voltage_low == 0 or reading.voltage == 0:
        # A servo that reset has lost its indirect mapping: nothing in this block is valid.
        axis.latch_reset()
    axis.misses = 0
    if axis.turn is not Turn.LOST:
        detect_reported(axis, reading)
    known = axis.turn in KNOWN_TURNS
    if known and axis.seen is not None and has_jumped(angle - axis.seen, time_s - axis.time_s):
        axis.latch_reset(
            f"its position jumped by {math.degrees(angle - axis.seen):+.0f} deg in "
            f"{1e3 * (time_s - axis.time_s):.0f} ms; {_JUMP}"
        )
    if axis.turn is Turn.LOST:
        return
    axis.value = angle
    if known:
        axis.seen = angle
    axis.time_s, axis.tick = time_s, reading.tick
    axis.velocity = reading.velocity * reg.RAD_S_PER_UNIT
    unit_ma = axis.model.ma_per_unit
    axis.effort = None if unit_ma is None else reading.current * unit_ma / 1e3
    if reading.voltage is not None:
        axis.voltage_v = reading.voltage / 10.0
    if reading.temperature is not None:
        axis.temperature_c = float(reading.temperature)
    if axis.state is TorqueState.ENABLED:
        _detect_standstill(axis, angle, axis.velocity)
        if axis.tendon.winding and axis.effort is not None:
            _detect_slack(axis, axis.effort, axis.velocity)


def detect_reported(axis: Axis, reading: ServoReading) -> None:
    """Detect what a reading reports as a fault; by the newest `Axis.hardware_error` where it has none."""
    if reading.hardware_error is not None:
        axis.hardware_error = reading.hardware_error
    if reading.alert or reading.hardware_error:
        if axis.fault == UNREAD_ALERT:
            axis.fault = ""
        message = reg.describe_hardware_error(axis.hardware_error)
        remedy = reg.remedy_of_hardware_error(axis.hardware_error)
        axis.latch(f"hardware error: {message}: {remedy}" if message else UNREAD_ALERT)
    if reading.torque is False and axis.enabled and reading.watchdog == axis.watchdog_units:
        axis.latch(TORQUE_OFF_FAULT)
    if not axis.watchdog_units or reading.watchdog in (None, axis.watchdog_units):
        return
    if reading.watchdog != reg.WATCHDOG_TRIPPED:
        axis.latch_reset()
        return
    waited_ms = axis.watchdog_units * reg.WATCHDOG_MS_PER_UNIT
    axis.latch(f"Bus Watchdog tripped: no instruction for {waited_ms} ms, it stopped")
    if axis.state is TorqueState.HOLD_PENDING:
        axis.state = TorqueState.IDLE


def _detect_standstill(axis: Axis, value: float, velocity: float) -> None:
    following = axis.following
    if axis.goal is None:
        return
    error, greatest_ma = axis.goal - value, axis.greatest_ma
    load = None if axis.effort is None or not greatest_ma else abs(axis.effort) * 1e3 / greatest_ma
    if not following.is_exceeded(error, velocity, load, axis.time_s):
        return
    current = "" if axis.effort is None else f" with {1e3 * abs(axis.effort):.0f} mA"
    axis.latch(
        f"it does not follow: {abs(math.degrees(error)):.0f} deg behind its goal for "
        f"{1e3 * following.time_s:.0f} ms{current}; a blocked shaft or a dead encoder?"
    )


def _detect_slack(axis: Axis, effort: float, velocity: float) -> None:
    tendon = axis.tendon
    if not tendon.is_exceeded(effort, velocity, axis.time_s):
        return
    before = (
        f"{SNAPPED_TENDON}: {1e3 * tendon.before_a:.0f} mA before," if tendon.snapped else f"{SLACK_TENDON}:"
    )
    axis.latch(
        f"{before} {1e3 * tendon.winding * effort:.0f} mA for {1e3 * tendon.time_s:.0f} ms, "
        f"a taut one carries {1e3 * tendon.least_a:.0f}; look at the tendon, then run `contid home`"
    )
