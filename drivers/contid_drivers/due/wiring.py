"""Configuration of a board in counts, Pa, ADC steps and duty, from the options of the robot file.

Also the way back: which option a board refused, by the place that its answer names.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from contid.errors import DeviceError
from contid.hal import AxisOnBus, DeviceKind
from contid.hal.homing import BACKOFF_MIN_DEG, REPEAT_RAD
from contid.units import BAR, DEG
from contid_drivers.due.codes import ADC_MV, ADC_STEPS, DUTY_FULL
from contid_drivers.due.frames import crc16
from contid_drivers.due.motor_options import EndStop, LoadCell
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role

#: Readings of a converter (24 bit) further out are saturated, and of a pin this near to the top [mV].
CONVERTER_MOST: Final = 8_300_000
WIRE_TOP_MV: Final = 20.0
#: Travel of an axis without limits in the robot file [counts].
_OPEN: Final = 1_000_000_000
#: Fields of a motor channel in the order of the wire, with their struct codes; units: firmware/PROTOCOL.md.
MOTOR_FIELDS: Final = {
    "channel": "B", "safe": "B", "start": "B", "flags": "B", "bridge": "B",
    "low": "i", "high": "i", "velocity": "i", "acceleration": "i",
    "kp": "i", "ks": "i", "ki": "i", "kv": "i", "ka": "i",
    "friction": "h", "deadband": "i",
    "stall_duty": "h", "stall_ms": "H", "stall_current_ma": "H", "full_scale_ma": "H",
    "follow": "i", "power_up": "i",
    "home_velocity": "i", "home_duty": "h", "home_at": "i", "home_backoff": "i",
    "home_timeout_ms": "H", "home_repeat": "i",
}  # fmt: skip
#: Of a motor with a load cell, behind those.
TENSION_FIELDS: Final = {
    "converter": "B", "pull": "B",
    "raw_low": "i", "low": "i", "raw_high": "i", "high": "i", "valid_low": "i", "valid_high": "i",
    "silent_ms": "H", "floor": "i", "ceiling": "i", "give": "i", "take_up": "i", "slack_ms": "H",
}  # fmt: skip
#: The same for a regulator channel; its table of ``points`` pairs (duty ``H``, pressure ``i``) follows.
REGULATOR_FIELDS: Final = {
    "channel": "B", "safe": "B", "start": "B",
    "ceiling": "i", "slew": "i", "vent": "i",
    "raw_low": "H", "low": "i", "raw_high": "H", "high": "i",
    "wire_raw": "H", "leak": "i", "leak_ms": "H", "over": "i", "over_ms": "H",
    "lag_ms": "H", "trim": "i", "trim_rate": "i", "points": "B",
}  # fmt: skip
#: Bytes of a configure message before the configuration (header, checksum), and of that before its channels
#: (role, watchdog, number of channels).
_HEAD: Final = 3 + 2
_BOARD: Final = 1 + 2 + 1


def axis_options(axis: AxisOnBus) -> DueAxisOptions:
    """Options of an axis, typed."""
    assert isinstance(axis.options, DueAxisOptions)
    return axis.options


def board_units(options: DueAxisOptions) -> float:
    """The board's units in one of the HAL's: counts per rad of a motor, Pa per Pa of a regulator."""
    return options.counts_per_rev / math.tau if options.kind is DeviceKind.MOTOR else 1.0


def _duty(percent: float) -> int:
    return round(percent / 100.0 * DUTY_FULL)


@dataclass(frozen=True)
class Adc:
    """Full scale of a board's analogue inputs, from its hello."""

    steps: int = ADC_STEPS
    mv: float = ADC_MV

    def of(self, millivolt: float) -> int:
        """The reading of a voltage, in steps.

        Raises:
            OverflowError: the input does not reach that far.
        """
        if millivolt > self.mv:
            raise OverflowError(f"{millivolt:g} mV at the pin, but the board's inputs end at {self.mv:g} mV")
        return round(millivolt / self.mv * self.steps)


DUE_ADC: Final = Adc()


def _pack(fields: Mapping[str, str], values: Mapping[str, int]) -> bytes:
    """Values by name in the order of the wire.

    Raises:
        OverflowError: a value exceeds its field; names the field.
    """
    assert values.keys() == fields.keys()
    packed = b""
    for name, code in fields.items():
        try:
            packed += struct.pack(f"<{code}", values[name])
        except struct.error:
            raise OverflowError(f"{name} = {values[name]} exceeds its field on the board") from None
    return packed


def _motor(axis: AxisOnBus, o: DueAxisOptions, adc: Adc) -> bytes:
    per_deg = o.counts_per_rev / 360.0
    low, high = -_OPEN, _OPEN
    if axis.travel is not None:
        # Rounded outwards, so that the ends of the travel can be reached.
        low, high = math.floor(axis.travel[0] * board_units(o)), math.ceil(axis.travel[1] * board_units(o))
    home = o.homing or EndStop(direction=1)
    flags = (
        o.encoder_reversed, o.motor_reversed, o.homing is not None, home.direction > 0, o.tension is not None
    )  # fmt: skip

    def gain(percent_per_deg: float) -> int:
        return round(percent_per_deg / 100.0 * DUTY_FULL / per_deg * 256.0)

    values = {
        "channel": o.number,
        "safe": o.safe.code,
        "start": o.start.code,
        "flags": sum(flag << bit for bit, flag in enumerate(flags)),
        "bridge": o.bridge.code,
        "low": low,
        "high": high,
        "velocity": round(o.velocity_deg_s * per_deg),
        "acceleration": round(o.acceleration_deg_s2 * per_deg),
        "kp": round(o.position_gain_per_s * 256.0),
        "ks": gain(o.speed_gain_percent_s_per_deg),
        "ki": gain(o.integral_percent_per_deg),
        "kv": gain(100.0 / o.no_load_deg_s),
        "ka": round(o.time_constant_ms / 1000.0 * DUTY_FULL / (o.no_load_deg_s * per_deg) * 65536.0),
        "friction": _duty(o.friction_percent),
        "deadband": round(o.deadband_deg * per_deg),
        "stall_duty": max(1, _duty(o.stall_percent)),
        "stall_ms": o.stall_ms,
        "stall_current_ma": round(o.stall_current_ma),
        "full_scale_ma": round(o.current_ma_per_v * adc.mv / 1000.0),
        "follow": max(1, round(o.follow_deg * per_deg)),
        "power_up": round(o.power_up_deg * per_deg),
        "home_velocity": max(1, round(home.speed_deg_s * per_deg)),
        "home_duty": max(1, _duty(home.duty_percent)),
        "home_at": round(home.at_deg * per_deg),
        "home_backoff": max(2, round(max(home.backoff_deg, BACKOFF_MIN_DEG) * per_deg)),
        "home_timeout_ms": round(home.timeout_s * 1000.0),
        "home_repeat": max(1, int(REPEAT_RAD / DEG * per_deg)),
    }
    return _pack(MOTOR_FIELDS, values) + (b"" if o.tension is None else _tension(o.tension, per_deg, adc))


def _tension(t: LoadCell, counts_per_deg: float, adc: Adc) -> bytes:
    (low, low_n), (high, high_n) = t.readings
    converter = t.cell == "converter"

    def raw(reading: float) -> int:
        return round(reading) if converter else adc.of(reading)

    # A tendon does not push: below minus its floor the cell is reversed, or has lost its zero.
    below = low + (-t.floor_n - low_n) * (high - low) / (high_n - low_n)
    ends = (-CONVERTER_MOST, CONVERTER_MOST) if converter else (t.wire_break_mv, adc.mv - WIRE_TOP_MV)
    inside = min(max(below, ends[0]), ends[1])
    valid = (inside, ends[1]) if high_n > low_n else (ends[0], inside)
    values = {
        "converter": int(converter),
        "pull": int(t.tightens > 0),
        "raw_low": raw(low),
        "low": round(low_n * 1000.0),
        "raw_high": raw(high),
        "high": round(high_n * 1000.0),
        "valid_low": raw(valid[0]),
        "valid_high": raw(valid[1]),
        "silent_ms": round(4000.0 / t.rate_hz) if converter else 0,
        "floor": round(t.floor_n * 1000.0),
        "ceiling": round(t.ceiling_n * 1000.0),
        "give": max(1, round(counts_per_deg / t.stiffness_n_per_deg * 256.0)),
        "take_up": max(1, round(t.take_up_deg * counts_per_deg)),
        "slack_ms": t.slack_ms,
    }
    return _pack(TENSION_FIELDS, values)


def _regulator(o: DueAxisOptions, adc: Adc) -> bytes:
    assert o.readback is not None
    assert o.ceiling_bar is not None
    (low_mv, low_bar), (high_mv, high_bar) = o.readback
    values = {
        "channel": o.number,
        "safe": o.safe.code,
        "start": o.start.code,
        "ceiling": round(o.ceiling_bar * BAR),
        "slew": round(o.slew_bar_s * BAR),
        "vent": round(o.vent_bar_s * BAR),
        "raw_low": adc.of(low_mv),
        "low": round(low_bar * BAR),
        "raw_high": adc.of(high_mv),
        "high": round(high_bar * BAR),
        "wire_raw": adc.of(o.wire_break_mv),
        "leak": round(o.leak_bar * BAR),
        "leak_ms": o.leak_ms,
        "over": round(o.over_bar * BAR),
        "over_ms": o.over_ms,
        "lag_ms": o.lag_ms,
        "trim": round(o.trim_bar * BAR),
        "trim_rate": round(o.trim_per_s * 256.0),
        "points": len(o.calibration or ()),
    }
    rows = b"".join(struct.pack("<Hi", _duty(duty), round(bar * BAR)) for duty, bar in o.calibration or ())
    if (pair := o.valves) is not None:
        opens = pair.outlet == "normally_open"
        rows = struct.pack("<BHHi", opens, pair.valve_ms, pair.least_ms, round(pair.band_bar * BAR))
    return _pack(REGULATOR_FIELDS, values) + rows


def board_config(bus: str, options: DueBusOptions, axes: Sequence[AxisOnBus], adc: Adc = DUE_ADC) -> bytes:
    """The configuration of one board, without its CRC.

    Raises:
        DeviceError: an axis belongs to the other kind of board, or a value exceeds its field or input.
    """
    kind = DeviceKind.MOTOR if options.role is Role.MOTOR else DeviceKind.REGULATOR
    blob = struct.pack("<BHB", options.role.code, options.watchdog_ms, len(axes))
    for axis in sorted(axes, key=lambda one: axis_options(one).number):
        o = axis_options(axis)
        if o.kind is not kind:
            raise DeviceError(
                f"{bus}: {axis.name}",
                f"channel {o.channel} does not exist on a {options.role} board",
                f"use {'m0..m5' if options.role is Role.MOTOR else 'p0..p5'}, or put it on the other board",
            )
        try:
            blob += _motor(axis, o, adc) if kind is DeviceKind.MOTOR else _regulator(o, adc)
        except OverflowError as error:
            raise DeviceError(f"{bus}: {axis.name}", str(error)) from None
    return blob


def config_body(blob: bytes) -> bytes:
    """The body of a configure message: CRC and configuration."""
    return struct.pack("<H", crc16(blob)) + blob


def refused_value(blob: bytes, axes: Sequence[AxisOnBus], detail: int) -> str:
    """``ROBOT.AXIS: FIELD VALUE``, in the units of the board; "" when the place is in no channel.

    Args:
        blob: the configuration, as `contid_drivers.due.wiring.board_config` makes it.
        axes: its axes.
        detail: of the refusal: bytes of the message up to the end of the value.
    """
    at, end = _BOARD, detail - _HEAD
    for axis in sorted(axes, key=lambda one: axis_options(one).number):
        options = axis_options(axis)
        motor = options.kind is DeviceKind.MOTOR
        tension = TENSION_FIELDS if options.tension is not None else {}
        for name, code in [*(MOTOR_FIELDS if motor else REGULATOR_FIELDS).items(), *tension.items()]:
            (value,) = struct.unpack_from(f"<{code}", blob, at)
            at += struct.calcsize(f"<{code}")
            if at >= end:
                return f"{axis.name}: {name} {value}"
        rows = "<BHHi" if options.valves is not None else "<" + "Hi" * len(options.calibration or ())
        at += 0 if motor else struct.calcsize(rows)
        if at >= end:
            return f"{axis.name}: {'valves' if options.valves is not None else 'calibration'}"
    return ""
