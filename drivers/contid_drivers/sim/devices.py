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
AMBIENT_C: Final = 25.0
_CONVERTER_STEPS: Final = 4095.0
#: A motor board joins commands to a stream as its firmware does: those no farther apart than this [s] and no
#: faster than this times its top speed; its set-point goes on for this number of their intervals.
STREAM_GAP_S: Final = 0.1
STREAM_EXCESS: Final = 2.5
STREAM_INTERVALS: Final = 2.0


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
    """One device on the bus."""

    # Shares of the current limit: friction of the gear, and the lag of the response at full speed. Free
    # motion therefore never reaches the limit; only a blocked shaft does.
    FRICTION_SHARE: Final = 0.05
    FULL_SPEED_SHARE: Final = 0.5
    THERMAL_TAU_S: Final = 120.0
    HEATING_C_PER_A2: Final = 30.0

    def __init__(self, options: SimAxisOptions, start: float, time_s: float, seed: str) -> None:
        self.kind = options.device
        self.character = character_of(options)
        #: Its profile and its own position (``contid/kernels/plant/profile.hpp``).
        self.motion: Any = load("plant").ProfileMotion(time_s, start, self.character.tau_s)
        self.goal = start
        self._top = self.character.velocity
        #: Newest command of a stream and its time [s].
        self._streamed = (start, -math.inf)
        #: True while the device follows goals: torque on, or regulator active.
        self.on = False
        self.rest = Rest.RELAX
        #: Latched fault as text, "" without one.
        self.fault = ""
        #: When the watchdog was last refreshed.
        self.fed_at_s = time_s
        self._noise = random.Random(seed)
        self._temperature_c = AMBIENT_C
        self._saturated_s = 0.0
        lag = max(self.character.velocity * self.character.tau_s, 10.0 * self.character.quantum)
        #: Where a body holds the shaft, None without one; the current for that, and its noise.
        self._shaft: float | None = None
        self._borne_a = self._current_noise_a = 0.0
        self._current_noise = random.Random(f"{seed}:current")
        self._amperes_per_lag = self.FULL_SPEED_SHARE * self.character.current_limit_a / lag

    def advance(self, to_s: float) -> bool:
        """Advance to ``to_s``; True when the device dropped its torque within this time."""
        dt = to_s - self.motion.time_s
        if dt <= 0.0:
            return False
        self.motion.advance(to_s)
        if self.character.current_limit_a <= 0.0:
            return False
        current = self.current_a
        warmest = AMBIENT_C + self.HEATING_C_PER_A2 * current * current
        self._temperature_c = warmest + (self._temperature_c - warmest) * math.exp(-dt / self.THERMAL_TAU_S)
        saturated = abs(current) >= self.character.current_limit_a
        self._saturated_s = self._saturated_s + dt if saturated else 0.0
        if self._saturated_s >= self.character.overload_s:
            self.overload()
            return True
        return False

    @property
    def current_a(self) -> float:
        """Current drawn [A]: friction plus a share that grows with the lag, limited."""
        if not self.on and self.rest is not Rest.HOLD:
            return 0.0
        motion, limit = self.motion, self.character.current_limit_a
        pull = self._amperes_per_lag * (motion.reference[0] - motion.value)
        if self._shaft is not None:
            return min(limit, max(-limit, self._borne_a + (pull if motion.blocked else 0.0)))
        current: float = pull + self.FRICTION_SHARE * limit * math.tanh(motion.velocity / 0.05)
        return min(limit, max(-limit, current))

    def bear(self, shaft: float, current_a: float, noise_a: float) -> None:
        """A body holds the shaft at an angle, which takes a current [A]; measured with noise [A]."""
        self._shaft, self._borne_a, self._current_noise_a = shaft, current_a, noise_a

    def switch_on(self, time_s: float) -> None:
        """Goal := present, then follow goals; arms the watchdog."""
        self.goal = self.motion.value
        self._streamed = (self.goal, -math.inf)
        self.motion.freeze()
        self.on = True
        self.fed_at_s = time_s

    def command(self, value: float) -> None:
        """Go to a goal, rounded to the device's steps and clamped to its range."""
        if not self.on:
            return
        character = self.character
        steps = round(min(character.highest, max(character.lowest, value)) / character.quantum)
        self.goal = steps * character.quantum
        (last, last_s), self._streamed = self._streamed, (value, self.motion.time_s)
        gap_s = self.motion.time_s - last_s
        if self.kind is DeviceKind.MOTOR and 0.0 < gap_s <= STREAM_GAP_S:
            rate = (value - last) / gap_s
            if abs(rate) <= STREAM_EXCESS * self._top:
                until_s = self.motion.time_s + STREAM_INTERVALS * gap_s
                self.motion.go_with(self.goal, rate, until_s, self._top, character.acceleration)
                return
        self.motion.go(self.goal, self._top, character.acceleration)

    def slow(self, share: float) -> None:
        """From the next command on its top speed is a share of what its kind has."""
        self._top = share * self.character.velocity

    def settle(self, rest: Rest) -> None:
        """Rest: hold (keep position, or close the valve), relax, or vent at the vent rate.

        A relaxed regulator vents, and a shaft cannot vent: ``vent`` relaxes it.
        """
        self.on = False
        self.rest = rest
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
        self._saturated_s = 0.0

    def read(self, now_s: float) -> Sample:
        """The device's answer now."""
        character, motion = self.character, self.motion
        noise = self._noise.gauss(0.0, character.noise) if character.noise > 0.0 else 0.0
        shaft = motion.value if self._shaft is None else self._shaft
        value = round((shaft + noise) / character.quantum) * character.quantum
        velocity = motion.velocity
        if character.velocity_quantum > 0.0:
            velocity = round(velocity / character.velocity_quantum) * character.velocity_quantum
        if self.kind is DeviceKind.REGULATOR:
            duty = motion.reference[0] / character.highest
            return Sample(max(0.0, value), now_s, True, 0.0, velocity, duty, None, None, self.fault)
        current = self.current_a
        if self._shaft is not None and current != 0.0:
            current += self._current_noise.gauss(0.0, self._current_noise_a)
        return Sample(
            value=value,
            time_s=now_s,
            valid=True,
            age_s=0.0,
            velocity=velocity,
            effort=round(current, 3),
            temperature_c=float(round(self._temperature_c)),
            voltage_v=round(character.supply_v - 0.2 * abs(current), 1),
            fault=self.fault,
        )
