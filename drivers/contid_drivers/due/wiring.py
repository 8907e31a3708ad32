"""Options in the units of people -> the board's configuration in counts, Pa, ADC steps and duty."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Final

from contid.errors import DeviceError
from contid.hal import AxisOnBus, DeviceKind
from contid.units import BAR
from contid_drivers.due.codes import ADC_MV, ADC_STEPS, DUTY_FULL, RoleCode, SafeCode
from contid_drivers.due.frames import crc16
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, EndStop, Role

#: Travel of an axis whose robot file leaves it open [counts].
_OPEN: Final = 1_000_000_000
_MOTOR = struct.Struct("<4B9ihih3H3ih2iH")
_REGULATOR = struct.Struct("<3B3iHiHiHiH2iB")


def axis_options(axis: AxisOnBus) -> DueAxisOptions:
    """The options of one axis with their type."""
    assert isinstance(axis.options, DueAxisOptions)
    return axis.options


class Scale:
    """Between the HAL's unit of one axis and the board's: rad and counts, or Pa and Pa."""

    def __init__(self, options: DueAxisOptions) -> None:
        motor = options.kind is DeviceKind.MOTOR
        self.per_unit = options.counts_per_rev / math.tau if motor else 1.0

    def to_board(self, value: float) -> int:
        """The HAL's value, rounded to the board's steps."""
        return round(value * self.per_unit)

    def from_board(self, value: int) -> float:
        """The board's value in the HAL's unit."""
        return value / self.per_unit


def _duty(percent: float) -> int:
    return round(percent / 100.0 * DUTY_FULL)


def _steps(millivolt: float) -> int:
    return round(millivolt / ADC_MV * ADC_STEPS)


def _bounds(axis: AxisOnBus, scale: Scale) -> tuple[int, int]:
    if axis.travel is None:
        return -_OPEN, _OPEN
    low, high = axis.travel
    # Rounded outwards: the ends of the travel can be reached.
    return math.floor(low * scale.per_unit), math.ceil(high * scale.per_unit)


def _motor(axis: AxisOnBus, o: DueAxisOptions) -> bytes:
    scale = Scale(o)
    per_deg = o.counts_per_rev / 360.0
    low, high = _bounds(axis, scale)
    home = o.homing or EndStop(direction=1)
    flags = (
        (1 if o.encoder_reversed else 0)
        | (2 if o.motor_reversed else 0)
        | (4 if o.homing else 0)
        | (8 if home.direction > 0 else 0)
    )

    def gain(percent_per_deg: float) -> int:
        return round(percent_per_deg / 100.0 * DUTY_FULL / per_deg * 256.0)

    full_scale_ma = o.current_ma_per_v * ADC_MV / 1000.0
    return _MOTOR.pack(
        o.number,
        SafeCode[o.safe.name],
        SafeCode[o.start.name],
        flags,
        low,
        high,
        round(o.velocity_deg_s * per_deg),
        round(o.acceleration_deg_s2 * per_deg),
        round(o.position_gain_per_s * 256.0),
        gain(o.speed_gain_percent_s_per_deg),
        gain(o.integral_percent_per_deg),
        gain(100.0 / o.no_load_deg_s),
        round(o.time_constant_ms / 1000.0 * DUTY_FULL / (o.no_load_deg_s * per_deg) * 65536.0),
        _duty(o.friction_percent),
        round(o.deadband_deg * per_deg),
        max(1, _duty(o.stall_percent)),
        o.stall_ms,
        round(o.stall_current_ma),
        min(0xFFFF, round(full_scale_ma)),
        max(1, round(o.follow_deg * per_deg)),
        round(o.power_up_deg * per_deg),
        max(1, round(home.speed_deg_s * per_deg)),
        max(1, _duty(home.duty_percent)),
        round(home.at_deg * per_deg),
        round(home.backoff_deg * per_deg),
        round(home.timeout_s * 1000.0),
    )


def _regulator(o: DueAxisOptions) -> bytes:
    assert o.calibration is not None
    assert o.readback is not None
    assert o.ceiling_bar is not None
    (low_mv, low_bar), (high_mv, high_bar) = o.readback
    body = _REGULATOR.pack(
        o.number,
        SafeCode[o.safe.name],
        SafeCode[o.start.name],
        round(o.ceiling_bar * BAR),
        round(o.slew_bar_s * BAR),
        round(o.vent_bar_s * BAR),
        _steps(low_mv),
        round(low_bar * BAR),
        _steps(high_mv),
        round(high_bar * BAR),
        _steps(o.wire_break_mv),
        round(o.leak_bar * BAR),
        o.leak_ms,
        round(o.trim_bar * BAR),
        round(o.trim_per_s * 256.0),
        len(o.calibration),
    )
    return body + b"".join(struct.pack("<Hi", _duty(duty), round(bar * BAR)) for duty, bar in o.calibration)


def board_config(bus: str, options: DueBusOptions, axes: Sequence[AxisOnBus]) -> bytes:
    """The whole configuration of one board, without its CRC.

    Raises:
        DeviceError: an axis is of the other kind of board, or a number does not fit the wire.
    """
    wanted = DeviceKind.MOTOR if options.role is Role.MOTOR else DeviceKind.REGULATOR
    blob = struct.pack("<BHB", RoleCode[options.role.name], options.watchdog_ms, len(axes))
    for axis in sorted(axes, key=lambda one: axis_options(one).number):
        o = axis_options(axis)
        if o.kind is not wanted:
            raise DeviceError(
                f"{bus}: {axis.name}",
                f"channel {o.channel} is no channel of a {options.role} board",
                f"use {'m0..m5' if options.role is Role.MOTOR else 'p0..p5'}, or put it on the other board",
            )
        try:
            blob += _motor(axis, o) if wanted is DeviceKind.MOTOR else _regulator(o)
        except struct.error as error:
            raise DeviceError(f"{bus}: {axis.name}", f"a number does not fit the board: {error}") from error
    return blob


def config_body(blob: bytes) -> bytes:
    """The body of a configure message: CRC, then the configuration."""
    return struct.pack("<H", crc16(blob)) + blob
