"""Robot-file keys of a Due board and of its channels. Motor values are those of the output shaft."""

from __future__ import annotations

import itertools
from typing import Annotated, Literal, TypeAlias

from pydantic import Field, model_validator

from contid.hal import DeviceKind
from contid.robot_file.base import NonNegative, Positive, Strict
from contid_drivers.due.codes import NamedCode

#: Calibration points of a regulator the board can hold.
MAX_CALIBRATION_POINTS = 8
Percent: TypeAlias = Annotated[float, Field(ge=0, le=100)]
#: An analogue pin reads up to this [mV].
PIN_MV = 3300.0
_ROUNDING = 1e-9
PinMillivolt: TypeAlias = Annotated[float, Field(ge=0, le=3300)]


class SafeState(NamedCode):
    """State of an output without a host.

    Motors: brake (terminals shorted), coast (bridge off), hold (position kept, under power). Regulators: vent
    (set-point falls to zero at ``vent_bar_s``), close (command to zero at once).
    """

    BRAKE = "brake"
    COAST = "coast"
    HOLD = "hold"
    VENT = "vent"
    CLOSE = "close"


class Role(NamedCode):
    """Kind of actuator a board drives."""

    MOTOR = "motor"
    PRESSURE = "pressure"


class Bridge(NamedCode):
    """Kind of H-bridge, by its lines.

    ``pwm_in_in``: enable or PWM and two inputs (VNH5019, L298). ``tb6612``: the same, but coasts with PWM
    high. ``in_in``: two inputs, the PWM line on the first (DRV8833, DRV8871). ``dir_pwm``: direction and PWM
    (DRV8838, MD10C); such a bridge brakes and cannot coast.
    """

    PWM_IN_IN = "pwm_in_in"
    TB6612 = "tb6612"
    IN_IN = "in_in"
    DIR_PWM = "dir_pwm"


class DueBusOptions(Strict):
    """Keys of ``buses.NAME`` with ``driver: due``.

    Attributes:
        port: device path, preferably ``/dev/serial/by-id/...``, or a glob that matches exactly one device.
        connection: ``native`` is the USB port of the SAM3X itself (fast, opening does not reset the board);
            ``programming`` goes through the board's second chip at 250000 baud, and opening it resets the
            board.
        role: ``motor`` or ``pressure``; the board's hello must match.
        board_id: unique id of the board's chip (`contid scan` prints it); another board is refused.
        watchdog_ms: watchdog of the board: without a valid demand for this time every armed channel goes to
            its safe state, latched.
        latency_ms: allowance for the adapter and the host, added to every time-out.
        hello_ms: time-out of `open` for the board's hello, a reset and its start-up included.
    """

    port: str = Field(min_length=1)
    connection: Literal["native", "programming"] = "native"
    role: Role
    board_id: Annotated[str, Field(pattern="^[0-9a-f]{32}$")] | None = None
    watchdog_ms: int = Field(default=100, ge=5, le=10_000)
    latency_ms: Annotated[float, Field(gt=0, le=200)] = 4.0
    hello_ms: Annotated[float, Field(ge=100, le=20_000)] = 3000.0


class EndStop(Strict):
    """Homing: drive slowly against the end stop until the shaft stands still, set the count, back off.

    Attributes:
        direction: sense of the shaft's rotation towards the stop.
        speed_deg_s: speed of the approach.
        duty_percent: duty limit of the approach; limits the force on the stop.
        at_deg: angle of the shaft at the stop, on the scale of the axis's ``zero_deg``.
        at_mm: length (or travel) of the actuator there.
        backoff_deg: distance moved back afterwards.
        timeout_s: time limit of the search.
    """

    direction: Literal[1, -1]
    speed_deg_s: Annotated[float, Field(gt=0, le=720)] = 45.0
    duty_percent: Annotated[float, Field(gt=0, le=100)] = 40.0
    at_deg: float = 0.0
    at_mm: float = 0.0
    backoff_deg: NonNegative = 5.0
    timeout_s: Annotated[float, Field(gt=0, le=60)] = 30.0


class LoadCell(Strict):
    """A load cell in the tendon of a motor: the board holds a floor of tension.

    Attributes:
        cell: ``amplifier`` at the tension pin, or ``converter`` (HX711, HX717, ADS1232) at its two lines.
        readings: two rows, the first with the lower reading: ``[mV at the pin, N]``, or of a converter
            ``[reading, N]``; measured with two weights.
        floor_n: least tension. The board follows the demand only as far as the tension stays above it, and
            pulls where it is below. It is held while the axis is armed or stopped, and without a host where
            ``on_watchdog`` is ``hold``.
        ceiling_n: tension above it for 20 ms is a fault.
        stiffness_n_per_deg: change of the tension per degree of the shaft at the stiffest pose; rather too
            large than too small.
        tightens: sense of rotation of the shaft that tightens.
        take_up_deg: how far the floor may pull the shaft away from its demand.
        slack_ms: a tension below half of the floor for this time is a fault.
        wire_break_mv: a lower signal at the pin means an open wire.
        rate_hz: readings per second of a converter.
    """

    cell: Literal["amplifier", "converter"] = "amplifier"
    readings: tuple[tuple[float, float], tuple[float, float]]
    floor_n: Annotated[float, Field(ge=0.02, le=2500)]
    ceiling_n: Annotated[float, Field(gt=0, le=10_000)]
    stiffness_n_per_deg: Annotated[float, Field(ge=0.0001, le=1000)]
    tightens: Literal[1, -1] = 1
    take_up_deg: Positive = 20.0
    slack_ms: int = Field(default=300, ge=10, le=10_000)
    wire_break_mv: PinMillivolt = 50.0
    rate_hz: Annotated[float, Field(ge=10, le=1000)] = 80.0

    @model_validator(mode="after")
    def _is_measured(self) -> LoadCell:
        (low, low_n), (high, high_n) = self.readings
        most = 8_388_607.0 if self.cell == "converter" else 3300.0
        if not low < high or low_n == high_n or max(abs(low), abs(high)) > most:
            unit = "a converter's reading" if self.cell == "converter" else "mV"
            raise ValueError(
                f"readings: {unit} must rise within {most:g}, and N must differ between the rows"
            )
        if self.cell == "amplifier" and low <= self.wire_break_mv:
            raise ValueError(f"readings must lie above wire_break_mv {self.wire_break_mv:g}")
        newtons = (high_n - low_n) / (high - low)
        ends = (-most if self.cell == "converter" else self.wire_break_mv, most)
        top_n = max(low_n + (end - low) * newtons for end in ends)
        if self.ceiling_n > top_n * (1.0 + _ROUNDING):
            raise ValueError(f"ceiling_n {self.ceiling_n:g} is never read: readings end at {top_n:.4g} N")
        if self.ceiling_n < 2.0 * self.floor_n:
            raise ValueError(f"ceiling_n {self.ceiling_n:g} must be at least twice floor_n {self.floor_n:g}")
        return self


class MotorOptions(Strict):
    """Keys of an axis on a channel ``m0`` .. ``m5``.

    Attributes:
        counts_per_rev: encoder counts (every edge of both tracks) per turn of the output shaft;
            398:1 gear and 12 counts per motor turn by default.
        velocity_deg_s: speed limit of the shaft; streamed demands below it pass unchanged (2 % are reserved
            for catching up).
        acceleration_deg_s2: acceleration limit of the shaft; streamed demands below it pass unchanged.
        position_gain_per_s: speed per position error.
        speed_gain_percent_s_per_deg: duty per speed error.
        integral_percent_per_deg: duty per integral of the speed error.
        no_load_deg_s: speed of the unloaded shaft at full duty, for the speed feed-forward.
        time_constant_ms: speed response of the loaded shaft, for the acceleration feed-forward.
        friction_percent: duty that just moves the shaft; added in the direction of motion.
        deadband_deg: position error without correction, against hunting; at least the play between motor
            and encoder.
        stall_percent: duty that moves the shaft under its load in any case. Without an advance of its count
            above it, the board ends the motion within milliseconds: the shaft is blocked, or the encoder
            dead. With ``time_constant_ms`` and ``no_load_deg_s`` it gives the slowest shaft that is none.
        stall_ms: this duty for this time without a count is a stall in any case; the one that counts where a
            current sensor shows the stall current.
        stall_current_ma: motor current of a stall; 0 without a current sensor. Needs ``current_ma_per_v``.
        current_ma_per_v: current per volt at the board's analogue input.
        follow_deg: limit of the following error.
        bridge: the motor's H-bridge: ``pwm_in_in`` (VNH5019, L298), ``tb6612``, ``in_in`` (DRV8833, DRV8871)
            or ``dir_pwm`` (DRV8838, MD10C; it cannot coast).
        encoder_reversed: inverts the count; positive duty must count up.
        motor_reversed: inverts the duty; positive duty must count up.
        power_up_deg: angle of the shaft at power-up (the parked pose).
        homing: search of the zero; without it ``power_up_deg`` is used unchecked.
        tension: load cell in its tendon, and the floor of tension that the board holds.
    """

    counts_per_rev: Annotated[float, Field(ge=4, le=1_000_000)] = 4776.0
    velocity_deg_s: Positive = 470.0
    acceleration_deg_s2: Positive = 2300.0
    position_gain_per_s: Annotated[float, Field(ge=0, le=1000)] = 20.0
    speed_gain_percent_s_per_deg: NonNegative = 0.4
    integral_percent_per_deg: NonNegative = 2.0
    no_load_deg_s: Positive = 575.0
    time_constant_ms: Annotated[float, Field(ge=0, le=2000)] = 40.0
    friction_percent: Percent = 5.0
    deadband_deg: NonNegative = 0.16
    stall_percent: Percent = 40.0
    stall_ms: int = Field(default=200, ge=10, le=10_000)
    stall_current_ma: NonNegative = 0.0
    current_ma_per_v: Annotated[float, Field(gt=0, le=19_800)] = 1000.0  # 16 bits on the wire, at 3.3 V
    follow_deg: Positive = 45.0
    bridge: Bridge = Bridge.PWM_IN_IN
    encoder_reversed: bool = False
    motor_reversed: bool = False
    power_up_deg: float = 0.0
    homing: EndStop | None = None
    tension: LoadCell | None = None


class ValvePair(Strict):
    """An inlet and an outlet valve, both on or off, at one chamber with a pressure sensor.

    Attributes:
        outlet: ``normally_open`` (without power the chamber vents) or ``normally_closed`` (it keeps its
            pressure while the board restarts; the axis needs ``start_state: hold``).
        valve_ms: longest time in which a valve opens or shuts; rather too long than too short.
        least_ms: shortest pulse of a valve.
        band_bar: error of the pressure without a pulse.
    """

    outlet: Literal["normally_open", "normally_closed"]
    valve_ms: int = Field(default=10, ge=1, le=500)
    least_ms: int = Field(default=5, ge=1, le=500)
    band_bar: Positive = 0.01


class RegulatorOptions(Strict):
    """Keys of an axis on a channel ``p0`` .. ``p5``.

    Attributes:
        calibration: rows ``[duty_percent, bar]``, both rising; the regulator's command, measured.
        valves: a pair of valves in place of a regulator, without ``calibration``.
        readback: two rows ``[mV at the analogue pin, bar]``; the regulator's pressure output, measured.
        ceiling_bar: limit of demands; a reading well above it vents.
        slew_bar_s: rate limit of the set-point.
        vent_bar_s: rate at which it falls to zero in the safe state ``vent``.
        wire_break_mv: a lower signal means a broken wire (540 for 4-20 mA over 150 ohm: 3.6 mA); 0 for
            signals that start at 0 V, where a break shows as a leak.
        leak_bar: a reading this far below the set-point for ``leak_ms`` is a leak; below a set-point of twice
            this value, half the set-point (at least a quarter of ``leak_bar``).
        leak_ms: see ``leak_bar``.
        over_bar: a reading this far above the set-point, or above zero at rest, that does not fall within
            ``over_ms`` is a fault.
        over_ms: see ``over_bar``.
        lag_ms: time constant with which the reading follows a step, measured at the chamber. A reading that
            stands still (within an eighth of ``leak_bar``) while a set-point with this lag moves by
            ``leak_bar`` is a fault.
        trim_bar: limit of the correction by an outer loop on the reading, and never more than half the
            set-point; 0 switches the loop off. It rests while the reading is outside ``leak_bar`` or
            ``over_bar``.
        trim_per_s: gain of that loop, per second and bar of error.
    """

    calibration: tuple[tuple[float, float], ...] | None = None
    valves: ValvePair | None = None
    readback: tuple[tuple[PinMillivolt, float], tuple[PinMillivolt, float]] | None = None
    ceiling_bar: Annotated[float, Field(gt=0, le=20)] | None = None
    slew_bar_s: Annotated[float, Field(gt=0, le=100)] = 2.0
    vent_bar_s: Annotated[float, Field(gt=0, le=100)] = 2.0
    wire_break_mv: PinMillivolt = 0.0
    leak_bar: Positive = 0.2
    leak_ms: int = Field(default=500, ge=10, le=10_000)
    over_bar: Positive = 0.2
    over_ms: int = Field(default=1000, ge=10, le=10_000)
    lag_ms: int = Field(default=150, ge=1, le=10_000)
    trim_bar: NonNegative = 0.0
    trim_per_s: NonNegative = 2.0


class DueAxisOptions(MotorOptions, RegulatorOptions):
    """Keys of an axis on a Due board, next to the common ones; the channel's letter selects which apply.

    Attributes:
        channel: ``m0`` .. ``m5`` on a motor board, ``p0`` .. ``p5`` on a pressure board.
        on_watchdog: safe state, taken when the watchdog trips: ``brake`` (default), ``coast`` or ``hold`` for
            motors; with ``tension``, ``hold`` by default, which goes on above its floor; ``vent`` (default)
            or ``close`` for regulators.
        start_state: what the wiring makes the motor do while the board does not drive its lines (in reset, in
            the boot loader, before the first host): ``brake`` (default; inputs pulled up, or the PWM line of
            ``dir_pwm`` pulled down) or ``coast`` (inputs pulled down). ``on_watchdog`` must be the same; for
            ``on_watchdog: hold`` write down which it is, because no wiring holds. Regulators: ``close``, by
            the pull-down at the command; ``hold`` for valves whose outlet is shut without power.
    """

    channel: Literal["m0", "m1", "m2", "m3", "m4", "m5", "p0", "p1", "p2", "p3", "p4", "p5"]
    on_watchdog: SafeState | None = None
    start_state: SafeState | None = None

    @property
    def kind(self) -> DeviceKind:
        """Motor or regulator."""
        return DeviceKind.MOTOR if self.channel[0] == "m" else DeviceKind.REGULATOR

    @property
    def parkable(self) -> bool:
        """True for a motor without homing: it counts from its parked pose after a restart of the board."""
        return self.kind is DeviceKind.MOTOR and self.homing is None

    @property
    def number(self) -> int:
        """The channel's number on its board, 0..5."""
        return int(self.channel[1])

    @property
    def safe(self) -> SafeState:
        """The safe state; the default of this kind if not given."""
        default = SafeState.BRAKE if self.kind is DeviceKind.MOTOR else SafeState.VENT
        if self.tension is not None:
            default = SafeState.HOLD
        return self.on_watchdog or default

    @property
    def start(self) -> SafeState:
        """The start state; that of the wiring in docs/devices/due.md if not given."""
        default = SafeState.BRAKE if self.kind is DeviceKind.MOTOR else SafeState.CLOSE
        return self.start_state or default

    @model_validator(mode="after")
    def _fits_its_channel(self) -> DueAxisOptions:
        motor = self.kind is DeviceKind.MOTOR
        other = RegulatorOptions if motor else MotorOptions
        foreign = sorted(self.model_fields_set & other.model_fields.keys())
        if foreign:
            what = "motor" if motor else "regulator"
            raise ValueError(f"channel {self.channel} is a {what}; it has no {', '.join(foreign)}")
        allowed = (
            (SafeState.BRAKE, SafeState.COAST, SafeState.HOLD) if motor else (SafeState.VENT, SafeState.CLOSE)
        )
        if self.safe not in allowed:
            raise ValueError(f"on_watchdog of channel {self.channel} must be one of {', '.join(allowed)}")
        if motor:
            if self.velocity_deg_s > self.no_load_deg_s:
                raise ValueError(
                    f"velocity_deg_s {self.velocity_deg_s:g} exceeds no_load_deg_s {self.no_load_deg_s:g}, "
                    "the speed of the motor at full duty"
                )
            self._check_range_of_motor()
            self._check_start()
        else:
            self._check_regulator()
        return self

    def _check_range_of_motor(self) -> None:
        full_ma = PIN_MV / 1e3 * self.current_ma_per_v
        if self.stall_current_ma >= full_ma:
            raise ValueError(
                f"stall_current_ma {self.stall_current_ma:g} is never read: the pin ends at {full_ma:g} mA "
                f"(3.3 V, current_ma_per_v {self.current_ma_per_v:g})"
            )
        if self.homing is not None and self.homing.speed_deg_s > self.no_load_deg_s:
            raise ValueError(
                f"homing: speed_deg_s {self.homing.speed_deg_s:g} exceeds no_load_deg_s "
                f"{self.no_load_deg_s:g}, the speed of the motor at full duty"
            )

    def _check_start(self) -> None:
        no_coast = self.bridge is Bridge.DIR_PWM
        possible = (SafeState.BRAKE,) if no_coast else (SafeState.BRAKE, SafeState.COAST)
        if self.start not in possible:
            raise ValueError(
                f"start_state {self.start} of channel {self.channel} is not possible "
                f"with bridge {self.bridge}; possible: {', '.join(possible)}"
            )
        if self.safe is SafeState.HOLD:
            if self.start_state is None:
                raise ValueError(
                    "on_watchdog hold needs start_state: a reset ends the holding, and the motor does what "
                    f"its wiring gives ({' or '.join(possible)})"
                )
        elif self.safe is not self.start:
            raise ValueError(
                f"start_state {self.start} differs from on_watchdog {self.safe}: a reset leaves the safe "
                "state, so the board refuses this configuration"
            )

    def _check_regulator(self) -> None:
        keeps = self.valves is not None and self.valves.outlet == "normally_closed"
        if self.start is not (SafeState.HOLD if keeps else SafeState.CLOSE):
            why = (
                "an outlet that is shut without power keeps the pressure in a reset: write hold, "
                "or fit a valve that is open without power"
                if keeps
                else "in a reset the pull-down sets the command to zero at once (close)"
            )
            raise ValueError(f"start_state {self.start} of channel {self.channel} is not possible: {why}")
        needed = ("readback", "ceiling_bar") if self.valves else ("calibration", "readback", "ceiling_bar")
        missing = [key for key in needed if getattr(self, key) is None]
        if missing:
            raise ValueError(f"channel {self.channel} is a regulator and needs {', '.join(missing)}")
        assert self.readback is not None
        (low_mv, low_bar), (high_mv, high_bar) = self.readback
        if not (low_mv < high_mv and low_bar < high_bar):
            raise ValueError("readback: mV and bar must both rise from the first row to the second")
        if self.valves is None:
            self._check_calibration()
        elif self.calibration is not None or self.trim_bar:
            raise ValueError(f"channel {self.channel} has valves; it has no calibration and no trim_bar")
        self._check_readback()

    def _check_readback(self) -> None:
        assert self.readback is not None
        (low_mv, low_bar), (high_mv, high_bar) = self.readback
        assert self.ceiling_bar is not None
        bar_per_mv = (high_bar - low_bar) / (high_mv - low_mv)
        top_bar, zero_mv = high_bar + (PIN_MV - high_mv) * bar_per_mv, low_mv - low_bar / bar_per_mv
        if self.ceiling_bar > top_bar * (1.0 + _ROUNDING):
            raise ValueError(
                f"ceiling_bar {self.ceiling_bar:g} is never read: "
                f"readback ends at {top_bar:.4g} bar (3300 mV)"
            )
        if self.wire_break_mv and self.wire_break_mv >= zero_mv:
            raise ValueError(
                f"wire_break_mv {self.wire_break_mv:g} must be below {zero_mv:.4g} mV, "
                "which readback has at 0 bar"
            )

    def _check_calibration(self) -> None:
        assert self.calibration is not None
        assert self.ceiling_bar is not None
        rows = self.calibration
        if not 2 <= len(rows) <= MAX_CALIBRATION_POINTS:
            raise ValueError(f"calibration has 2 to {MAX_CALIBRATION_POINTS} rows, got {len(rows)}")
        if not all(0.0 <= duty <= 100.0 for duty, _ in rows):
            raise ValueError("calibration: duty_percent is 0 to 100")
        if not all(a[0] < b[0] and a[1] < b[1] for a, b in itertools.pairwise(rows)):
            raise ValueError("calibration: duty_percent and bar must both rise from row to row")
        if not rows[0][1] <= 0.0 <= self.ceiling_bar <= rows[-1][1]:
            raise ValueError(
                f"calibration must reach from 0 bar to ceiling_bar {self.ceiling_bar:g}, "
                f"it covers {rows[0][1]:g} to {rows[-1][1]:g}"
            )
