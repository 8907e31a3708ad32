"""Simulated devices: an XL330 servo, a geared motor with encoder, a pressure regulator.

All three share one model with different numbers: a goal quantised to the device's steps, a profile towards
it, a first-order response, a reading with noise and quantisation, and rest states. Numbers without a data
sheet are plausible choices, not measurements.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from contid.hal import RESPONSES, DeviceKind, DeviceResponse, Rest, Sample
from contid.kernels import load
from contid.units import BAR
from contid_drivers.sim.options import SimAxisOptions

RPM: Final = 2.0 * math.pi / 60.0
_CONVERTER_STEPS: Final = 4095.0


@dataclass(frozen=True, slots=True)
class Character:
    """Constants of one kind of device; rad or Pa, and s.

    Attributes:
        quantum: step of goals and readings.
        velocity_quantum: step of the reported velocity, 0 for none.
        lowest, highest: the device clamps goals to this range.
        velocity, acceleration: limits of the profile.
        vent_rate: speed towards zero while venting.
        tau_s: time constant of the first-order response [s].
        noise: standard deviation of a reading before quantisation.
        current_limit_a: 0 for devices that report no current.
        overload_s: time at the current limit after which the device drops its torque.
        overload: its fault text.
        supply_v: voltage at rest, 0 for devices that report none.
        on_watchdog: state of rest that the watchdog brings.
    """

    quantum: float
    velocity_quantum: float
    lowest: float
    highest: float
    velocity: float
    acceleration: float
    vent_rate: float
    tau_s: float
    noise: float
    current_limit_a: float
    overload_s: float
    overload: str
    supply_v: float
    on_watchdog: Rest


# XL330-M288-T at 5 V: 4096 ticks per turn, +-256 turns, 103 rpm, 1.47 A, velocity unit 0.229 rpm.
_SERVO: Final = Character(
    quantum=2.0 * math.pi / 4096.0,
    velocity_quantum=0.229 * RPM,
    lowest=-512.0 * math.pi,
    highest=512.0 * math.pi,
    velocity=103.0 * RPM,
    acceleration=500.0,
    vent_rate=math.inf,
    tau_s=0.015,
    noise=0.3 * 2.0 * math.pi / 4096.0,
    current_limit_a=1.47,
    overload_s=1.0,
    overload="overload",
    supply_v=5.0,
    on_watchdog=Rest.HOLD,
)
# 398:1 gear, 12 edges per motor turn: 4776 counts per turn of the shaft, 100 mm/s on a pinion of 25 mm.
_MOTOR: Final = Character(
    quantum=2.0 * math.pi / 4776.0,
    velocity_quantum=0.0,
    lowest=-math.inf,
    highest=math.inf,
    velocity=8.0,
    acceleration=80.0,
    vent_rate=math.inf,
    tau_s=0.01,
    noise=0.0,
    current_limit_a=1.0,
    overload_s=0.5,
    overload="stalled",
    supply_v=12.0,
    on_watchdog=Rest.HOLD,
)
# Proportional regulator behind a 12-bit converter over its ceiling.
_REGULATOR: Final = Character(
    quantum=3.0 * BAR / _CONVERTER_STEPS,
    velocity_quantum=0.0,
    lowest=0.0,
    highest=3.0 * BAR,
    velocity=5.0 * BAR,
    acceleration=math.inf,
    vent_rate=2.0 * BAR,
    tau_s=0.05,
    noise=0.003 * BAR,
    current_limit_a=0.0,
    overload_s=math.inf,
    overload="regulator fault",
    supply_v=0.0,
    on_watchdog=Rest.VENT,
)
_OF_KIND: Final = {
    DeviceKind.SERVO: _SERVO,
    DeviceKind.MOTOR: _MOTOR,
    DeviceKind.REGULATOR: _REGULATOR,
}


def _pascals(bar: float) -> float:
    return bar * BAR


def _thousandth(value: float) -> float:
    return value / 1e3


#: Key of the robot file: the constant that it sets, and its conversion.
_OVERRIDES: Final[dict[str, tuple[str, Callable[[Any], float | Rest]]]] = {
    "velocity_deg_s": ("velocity", math.radians),
    "acceleration_deg_s2": ("acceleration", math.radians),
    "counts_per_rev": ("quantum", lambda counts: 2.0 * math.pi / counts),
    "noise_deg": ("noise", math.radians),
    "current_limit_ma": ("current_limit_a", _thousandth),
    "overload_s": ("overload_s", float),
    "response_ms": ("tau_s", _thousandth),
    "slew_bar_s": ("velocity", _pascals),
    "vent_bar_s": ("vent_rate", _pascals),
    "ceiling_bar": ("highest", _pascals),
    "noise_bar": ("noise", _pascals),
    "on_watchdog": ("on_watchdog", Rest),
}


def character_of(options: SimAxisOptions) -> Character:
    """The numbers of one axis: those of its kind, overridden by the robot file."""
    given = options.model_dump(exclude_none=True)
    changes: dict[str, Any] = {
        constant: convert(given[key]) for key, (constant, convert) in _OVERRIDES.items() if key in given
    }
    if "highest" in changes:
        changes["quantum"] = changes["highest"] / _CONVERTER_STEPS
    return replace(_OF_KIND[options.device], **changes)


def simulated_response(options: SimAxisOptions) -> DeviceResponse:
    """The response of the device of an axis, with a third more lag than it has where the file sets that."""
    response = RESPONSES[options.device]
    if options.response_ms is not None:
        response = replace(response, lag_s=max(response.lag_s, options.response_ms / 750.0))
    if options.slew_bar_s is not None:
        response = replace(response, top=options.slew_bar_s * BAR)
    return response


class SimDevice:
    """One device on the bus; it moves, warms up and reads in ``contid/kernels/plant/device.hpp``."""

    # Share of the current limit that the lag of the response at full speed takes. Free motion therefore never
    # reaches the limit; only a blocked shaft does.
    FULL_SPEED_SHARE: Final = 0.5

    def __init__(self, options: SimAxisOptions, start: float, time_s: float, seed: str) -> None:
        self.kind = options.device
        self.character = character = character_of(options)
        lag = max(character.velocity * character.tau_s, 10.0 * character.quantum)
        #: Its profile, its own position, and the current for both.
        self.motion: Any = load("plant").SimulatedDevice(
            time_s, start, character.tau_s, character.velocity, character.quantum, character.velocity_quantum,
            character.lowest, character.highest, character.acceleration, character.current_limit_a,
            character.overload_s, self.FULL_SPEED_SHARE * character.current_limit_a / lag,
            self.kind is DeviceKind.MOTOR,
        )  # fmt: skip
        self.goal = start
        #: True while the device follows goals: torque on, or regulator active.
        self.on = False
        self.rest = Rest.RELAX
        #: Latched fault as text, "" without one.
        self.fault = ""
        #: When the watchdog was last refreshed.
        self.fed_at_s = time_s
        self._noise = random.Random(seed)
        #: Noise of the current of a shaft that a body holds, None without one.
        self._current_noise_a: float | None = None
        self._current_noise = random.Random(f"{seed}:current")

    def advance(self, to_s: float) -> bool:
        """Advance to ``to_s``; True when the device dropped its torque within this time."""
        if not self.motion.advance(to_s):
            return False
        self.overload()
        return True

    def bear(self, shaft: float, current_a: float, noise_a: float) -> None:
        """A body holds the shaft at an angle, which takes a current [A]; measured with noise [A]."""
        self.motion.bear(shaft, current_a)
        self._current_noise_a = noise_a

    def switch_on(self, time_s: float) -> None:
        """Goal := present, then follow goals; arms the watchdog."""
        self.goal = self.motion.value
        self.motion.switch_on()
        self.on = True
        self.fed_at_s = time_s

    def command(self, value: float) -> None:
        """Go to a goal, rounded to the device's steps and clamped to its range."""
        if self.on:
            self.goal = self.motion.command(value)

    def slow(self, share: float) -> None:
        """From the next command on its top speed is a share of what its kind has."""
        self.motion.top = share * self.character.velocity

    def settle(self, rest: Rest) -> None:
        """Rest: hold (keep position, or close the valve), relax, or vent at the vent rate.

        A relaxed regulator vents, and a shaft cannot vent: ``vent`` relaxes it.
        """
        self.on = False
        self.rest = rest
        self.motion.powered = rest is Rest.HOLD
        if self.kind is not DeviceKind.REGULATOR and not self.motion.blocked:
            self.motion.stop()
        elif self.kind is not DeviceKind.REGULATOR or rest is Rest.HOLD:
            self.motion.freeze()
        else:
            self.motion.go(0.0, self.character.vent_rate, math.inf)

    def trip(self, after_s: float) -> None:
        """Trip the watchdog: rest, latched."""
        self.settle(self.character.on_watchdog)
        self.fault = f"watchdog tripped: no exchange for {after_s * 1e3:g} ms"

    def overload(self) -> None:
        """Drop the torque and report it, latched."""
        self.settle(Rest.RELAX)
        self.fault = self.character.overload
        self.motion.saturated_s = 0.0

    def read(self, now_s: float) -> Sample:
        """The device's answer now."""
        character = self.character
        noise = self._noise.gauss(0.0, character.noise) if character.noise > 0.0 else 0.0
        value, velocity, current, temperature_c = self.motion.read(noise)
        if self.kind is DeviceKind.REGULATOR:
            duty = self.motion.reference[0] / character.highest
            return Sample(max(0.0, value), now_s, True, 0.0, velocity, duty, None, None, self.fault)
        if self._current_noise_a is not None and current != 0.0:
            current += self._current_noise.gauss(0.0, self._current_noise_a)
        voltage_v = round(character.supply_v - 0.2 * abs(current), 1)
        return Sample(
            value, now_s, True, 0.0, velocity, round(current, 3), temperature_c, voltage_v, self.fault
        )
