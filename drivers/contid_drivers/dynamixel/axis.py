"""State of one servo on the host; converts its readings into samples and faults."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from contid.errors import DeviceError
from contid.hal import SLACK_TENDON, SNAPPED_TENDON, AxisOnBus, Reference, Rest, Sample
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.exchange.block import ServoReading
from contid_drivers.dynamixel.models import BY_NAME, ServoModel
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions, Tensioning
from contid_drivers.dynamixel.plausibility import FollowingError, SlackTendon, has_jumped

RESET_FAULT = "it reset itself (brown-out?); its watchdog, settings and turn count are gone"
#: Following error allowed in extended position mode.
FOLLOWING_ERROR_DEG = 30.0
#: A motion between two readings that only comes after a gap, or a lost turn.
FAR_RAD = math.radians(45.0)
#: Difference of the time of the servo from that of the host, of readings that came late, and of its clock.
TICK_SLACK_MS = 50.0
TICK_SLACK = 0.05
TORQUE_OFF_FAULT = "its torque was switched off from outside: does another program use this bus?"

_UNREAD_ALERT = "hardware error: alert, cause not read yet"
_JUMP = "another program reset its count of turns, or its encoder is faulty"


@dataclass(slots=True)
class Axis:
    """One servo.

    Attributes:
        name: ``ROBOT.AXIS``.
        options: its keys in the robot file.
        travel: device range of the robot file [rad].
        operating_mode: value of register 11.
        device: id on the bus.
        model: its model in the robot file.
        firmware, return_delay_s: read at `open`.
        enabled: True from `arm` until a rest or a fault: commands are sent to it.
        watchdog_units: value last written to its Bus Watchdog, the time-out in units of 20 ms; 0 is off.
        turns: whole turns added to the servo's count; see `turns`.
        turn_known: ``turns`` was determined; cleared by whatever may have changed the servo's count.
        mark: which servo it is, see `identity`; "" where that is not known.
        marked: the servo keeps the mark of this turn, so that a reset can be recognised.
        seen: last position [rad] while the turn was known.
        misses: consecutive exchanges without an answer.
        fault: latched fault, empty for none.
        reset: the servo lost its RAM; nothing it reports is valid until `recover`.
        pending_rest: state of rest that the servo has not confirmed; applied when it answers.
        goal: newest command [rad] since it was armed.
        following: watch over the difference between goal and position.
        tendon: watch over the tendon on its spool; idle where homing does not tension one.
        value, time_s: last valid position [rad] and its time.
        tick: Realtime Tick of that reading, None where it was not read.
        effort_share: share of its current limit, see `grip`.
        reference: what its homing must agree with.
        own_pwm: its PWM Limit (36), read with its Current Limit.
        own_limit_ma: its Current Limit (38), read before it is armed in current-based position mode.
    """

    name: str
    options: DynamixelAxisOptions
    travel: tuple[float, float] | None
    operating_mode: int
    device: int
    model: ServoModel
    reference: Reference = field(default_factory=Reference)
    firmware: int = 0
    return_delay_s: float = 0.0
    enabled: bool = False
    watchdog_units: int = 0
    turns: int = 0
    turn_known: bool = False
    mark: str = ""
    marked: bool = False
    seen: float | None = None
    misses: int = 0
    fault: str = ""
    reset: bool = False
    pending_rest: Rest | None = None
    value: float | None = None
    time_s: float = 0.0
    tick: int | None = None
    velocity: float | None = None
    effort: float | None = None
    voltage_v: float | None = None
    temperature_c: float | None = None
    hardware_error: int = 0
    effort_share: float = 1.0
    own_pwm: int | None = None
    own_limit_ma: float | None = None
    goal: float | None = None
    following: FollowingError = field(default_factory=lambda: FollowingError(math.inf, 0.0))
    tendon: SlackTendon = field(default_factory=lambda: SlackTendon(0, 0.0, 0.0))

    @classmethod
    def of(cls, axis: AxisOnBus, bus: DynamixelBusOptions) -> Axis:
        """Build the servo of an axis of the robot file."""
        options = axis.options
        assert isinstance(options, DynamixelAxisOptions)
        mode, model = options.mode or bus.mode, BY_NAME[options.model]
        if mode == "current_based_position" and model.ma_per_unit is None:
            what = f"mode {mode} needs current registers, which {options.model} has not"
            raise DeviceError(axis.name, what, "write mode: extended_position at the axis")
        limit_deg = options.following_error_deg
        if limit_deg is None:
            # In the current-based mode pushing against something is the purpose.
            limit_deg = math.inf if mode == "current_based_position" else FOLLOWING_ERROR_DEG
        following = FollowingError(math.radians(limit_deg), options.following_error_ms / 1e3)
        return cls(
            axis.name,
            options,
            axis.travel,
            reg.MODE_NUMBERS[mode],
            options.id,
            model,
            following=following,
            tendon=_tendon_of(options),
            reference=axis.reference,
        )

    def to_rad(self, ticks: int) -> float:
        """Angle [rad] of a position the servo reports."""
        return (ticks + self.turns * reg.TICKS_PER_REV) * reg.RAD_PER_TICK

    def to_ticks(self, angle: float) -> int:
        """Nearest position count of an angle [rad]."""
        return round(angle / reg.RAD_PER_TICK) - self.turns * reg.TICKS_PER_REV

    def latch(self, fault: str) -> bool:
        """Latch a fault, stop commanding the servo and hold it; False when one is latched already.

        A servo that still has to relax does that.
        """
        if self.fault:
            return False
        self.fault, self.enabled, self.pending_rest = fault, False, self.pending_rest or Rest.HOLD
        return True

    def latch_reset(self, fault: str = RESET_FAULT) -> None:
        """The servo lost its turn count: it reset itself, or its position jumped."""
        if not self.reset:
            self.reset, self.turn_known, self.pending_rest = True, False, self.pending_rest or Rest.HOLD
        self.latch(fault)

    @property
    def dead(self) -> bool:
        """It was silent in the two last exchanges: not one lost packet, but a servo without power."""
        return self.misses > 1

    def arm(self, watchdog: int) -> None:
        """Torque and watchdog are on, the goal is the present position."""
        self.watchdog_units, self.enabled, self.pending_rest, self.goal = watchdog, True, None, None
        self.following.clear()
        self.tendon.clear()

    def may_have_reset(self, reading: ServoReading, time_s: float) -> bool:
        """Whether nothing in a reading excludes a reset since the one before.

        A lost mapping shows a reset in the mapped bytes. An armed watchdog does, and so does the time of the
        servo, unless a reset happens to fit it: then it missed exchanges. A long way may be whole turns.
        """
        if self.reset or not self.marked:
            return False
        if self.seen is not None and abs(self.to_rad(reading.position) - self.seen) > FAR_RAD:
            return reading.voltage_low != 0
        if self.watchdog_units or reading.voltage_low is not None:
            return False
        if self.misses or self.tick is None or reading.tick is None:
            return True
        elapsed_ms = 1e3 * (time_s - self.time_s)
        late_ms = math.remainder(reading.tick - self.tick - elapsed_ms, reg.REALTIME_TICKS)
        return abs(late_ms) > TICK_SLACK_MS + TICK_SLACK * elapsed_ms

    def record_miss(self, time_s: float) -> Sample:
        """No answer in this exchange."""
        self.misses += 1
        return self.sample(time_s, valid=False)

    def take(self, reading: ServoReading, time_s: float) -> None:
        """Store an answer that arrived at ``time_s``, and detect faults."""
        if reading.voltage_low == 0 or reading.voltage == 0:
            # A servo that reset has lost its indirect mapping: nothing in this block is valid.
            self.latch_reset()
        self.misses = 0
        if not self.reset:
            self.detect_faults(reading)
        value = self.to_rad(reading.position)
        if not self.reset and self.turn_known and self.seen is not None:
            elapsed_s = time_s - self.time_s
            if has_jumped(value - self.seen, elapsed_s):
                off_deg = math.degrees(value - self.seen)
                self.latch_reset(
                    f"its position jumped by {off_deg:+.0f} deg in {1e3 * elapsed_s:.0f} ms; {_JUMP}"
                )
        if self.reset:
            return
        self.value = value
        if self.turn_known:
            self.seen = value
        self.time_s, self.tick = time_s, reading.tick
        self.velocity = reading.velocity * reg.RAD_S_PER_UNIT
        unit_ma = self.model.ma_per_unit
        self.effort = None if unit_ma is None else reading.current * unit_ma / 1e3
        if reading.voltage is not None:
            self.voltage_v = reading.voltage / 10.0
        if reading.temperature is not None:
            self.temperature_c = float(reading.temperature)
        if self.enabled:
            self._detect_standstill(time_s)
            if self.tendon.winding:
                self._detect_slack(time_s)

    def _detect_standstill(self, time_s: float) -> None:
        if self.goal is None or self.value is None or self.velocity is None:
            return
        error = self.goal - self.value
        if abs(error) <= self.following.limit_rad:
            self.following.clear()
            return
        limit_ma = self.options.current_limit_ma or self.model.current_limit_ma
        load = None if self.effort is None or not limit_ma else abs(self.effort) * 1e3 / limit_ma
        if not self.following.is_exceeded(error, self.velocity, load, time_s):
            return
        current = "" if self.effort is None else f" with {1e3 * abs(self.effort):.0f} mA"
        self.latch(
            f"it does not follow: {abs(math.degrees(error)):.0f} deg behind its goal for "
            f"{1e3 * self.following.time_s:.0f} ms{current}; a blocked shaft or a dead encoder?"
        )

    def _detect_slack(self, time_s: float) -> None:
        if self.effort is None or self.velocity is None:
            return
        if not self.tendon.is_exceeded(self.effort, self.velocity, time_s):
            return
        now_ma, least_ma = 1e3 * self.tendon.winding * self.effort, 1e3 * self.tendon.least_a
        state = (
            f"{SNAPPED_TENDON}: {1e3 * self.tendon.before_a:.0f} mA before,"
            if self.tendon.snapped
            else f"{SLACK_TENDON}:"
        )
        self.latch(
            f"{state} {now_ma:.0f} mA for {1e3 * self.tendon.time_s:.0f} ms, "
            f"a taut one carries {least_ma:.0f}; look at the tendon, then run `contid home`"
        )

    def detect_faults(self, reading: ServoReading) -> None:
        """Detect what a reading reports as a fault; with the newest `hardware_error` where it has none."""
        if reading.hardware_error is not None:
            self.hardware_error = reading.hardware_error
        if reading.alert or reading.hardware_error:
            if self.fault == _UNREAD_ALERT:
                self.fault = ""
            message = reg.describe_hardware_error(self.hardware_error)
            remedy = reg.remedy_of_hardware_error(self.hardware_error)
            self.latch(f"hardware error: {message}: {remedy}" if message else _UNREAD_ALERT)
        if self.enabled and reading.torque is False and reading.watchdog == self.watchdog_units:
            self.latch(TORQUE_OFF_FAULT)
        if not self.watchdog_units or reading.watchdog is None or reading.watchdog == self.watchdog_units:
            return
        if reading.watchdog == reg.WATCHDOG_TRIPPED:
            waited = self.watchdog_units * reg.WATCHDOG_MS_PER_UNIT
            if self.latch(f"Bus Watchdog tripped: no instruction for {waited} ms, it stopped"):
                self.pending_rest = None
        else:
            self.latch_reset()

    def sample(self, now: float, valid: bool) -> Sample:
        """Its sample at the end of an exchange; valid if that brought an answer that counts."""
        return Sample(
            self.value,
            self.time_s,
            valid,
            now - self.time_s if self.value is not None else 0.0,
            self.velocity,
            self.effort,
            self.temperature_c,
            self.voltage_v,
            self.fault,
        )


def _tendon_of(options: DynamixelAxisOptions) -> SlackTendon:
    homing = options.homing
    if not isinstance(homing, Tensioning) or homing.slack_ma is None:
        return SlackTendon(0, 0.0, 0.0)
    return SlackTendon(homing.direction, homing.slack_ma / 1e3, homing.slack_ms / 1e3)
