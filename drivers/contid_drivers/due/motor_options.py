"""Robot-file keys of a motor on a Due board, with its bridge, end stop and load cell; of the output shaft."""

from __future__ import annotations

from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field, model_validator

from contid.robot_file.base import NonNegative, Positive, Strict
from contid_drivers.due.codes import NamedCode

Percent: TypeAlias = Annotated[float, Field(ge=0, le=100)]
#: An analogue pin reads up to this [mV].
PIN_MV: Final = 3300.0
#: Relative allowance for the rounding of what a file states.
ROUNDING: Final = 1e-9
PinMillivolt: TypeAlias = Annotated[float, Field(ge=0, le=3300)]


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
        if self.ceiling_n > top_n * (1.0 + ROUNDING):
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

    def check_motor(self) -> None:
        """Raise ValueError for a speed that the motor has not, and for a current that is never read."""
        if self.velocity_deg_s > self.no_load_deg_s:
            raise ValueError(
                f"velocity_deg_s {self.velocity_deg_s:g} exceeds no_load_deg_s {self.no_load_deg_s:g}, "
                "the speed of the motor at full duty"
            )
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
