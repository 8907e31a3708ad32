"""Motors whose shafts have tracks, for pulses: written apart from the firmware's plant and from its decoder.

The shaft has static and sliding friction and is integrated in steps of 100 us; each track is a level of the
angle, and the counter decodes the levels by their transitions, as a chip does. A fault of a wire acts on it.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field

from contid.hal.pulses import EncoderAnswer, ProvenDevice
from contid_devices.pulsed_motors import PulseAnswer

STEP_S = 100e-6
TRACE_S = 0.096


@dataclass
class Shaft:
    """One motor: no load speed [counts/s], time constant [s], friction [of full duty]."""

    no_load: float = 7630.0
    tau: float = 0.04
    friction: float = 0.05
    stiction: float = 1.0  # static friction in terms of the sliding one
    brakes: bool = True
    stall_a: float = 1.5
    stuck: bool = False
    connected: bool = True
    place: float = 0.0
    speed: float = 0.0

    def step(self, duty: float, driven: bool) -> float:
        """Move by one step; returns the current [A]."""
        if not self.connected:
            duty, driven = 0.0, False
        shorted = driven or self.brakes
        drive = (duty if driven else 0.0) * self.no_load - (self.speed if shorted and self.connected else 0.0)
        current = drive / self.no_load * self.stall_a if shorted and self.connected else 0.0
        hold = self.friction * self.no_load
        if self.stuck:
            return current
        if self.speed == 0.0:
            if abs(drive) <= hold * self.stiction:
                return current
            push = drive - math.copysign(hold, drive)
        else:
            push = drive - math.copysign(hold, self.speed)
        after = self.speed + push * STEP_S / self.tau
        if self.speed != 0.0 and after * self.speed <= 0.0:
            after = 0.0
        self.place += (self.speed + after) / 2.0 * STEP_S
        self.speed = after
        return current


@dataclass
class Wires:
    """Of one channel: which shaft and tracks it has, and what is wrong with them."""

    shaft: int
    motor: int = -1  # which shaft its motor turns; -1: the same
    track_a: tuple[int, str] | None = None  # (shaft, track) at the input of track A
    track_b: tuple[int, str] | None = None
    sense: int = 1  # of the motor
    lines: str = ""  # of the bridge: "forward", "same"
    fault_line: bool = False
    trips: bool = False
    noise: float = 0.0  # pulses per second on track A
    slow_filter: float = 0.0  # share of samples that the input loses


@dataclass
class Decoder:
    """A counter of quadrature, from levels."""

    a: int = 0
    b: int = 0
    count: int = 0
    edges_a: int = 0
    edges_b: int = 0
    missed: int = 0

    def see(self, a: int, b: int) -> None:
        changed_a, changed_b = a != self.a, b != self.b
        if changed_a and changed_b:
            self.missed += 1
        elif changed_a:
            # A leads B when the count goes down, in the order 00 01 11 10 of (A, B).
            self.count += 1 if a == b else -1
        elif changed_b:
            self.count += 1 if a != b else -1
        self.edges_a += changed_a
        self.edges_b += changed_b
        self.a, self.b = a, b


@dataclass
class Bench:
    """Channels and shafts behind one board (`contid_devices.pulsed_motors.PulsedBus`)."""

    shafts: list[Shaft]
    wires: dict[str, Wires]
    seed: int = 0
    current_noise: float = 0.01
    sensor: bool = False
    pulses: list[tuple[str, float, float]] = field(default_factory=list)
    furthest: dict[int, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for wires in self.wires.values():
            wires.motor = wires.shaft if wires.motor < 0 else wires.motor
        self._random = random.Random(self.seed)
        self._noisy = any(wires.noise or wires.slow_filter for wires in self.wires.values())
        self._quarters: list[int] = []
        self._start = [shaft.place for shaft in self.shafts]
        self._decoders = {name: Decoder(*self._levels(name)) for name in self.wires}

    def _track(self, source: tuple[int, str] | None, default: tuple[int, str]) -> int:
        shaft, track = source or default
        if track == "open":
            return 1
        quarter = math.floor(self.shafts[shaft].place) % 4
        return int(quarter in ((2, 3) if track == "a" else (1, 2)))

    def _levels(self, name: str) -> tuple[int, int]:
        wires = self.wires[name]
        a = self._track(wires.track_a, (wires.shaft, "a"))
        b = self._track(wires.track_b, (wires.shaft, "b"))
        if wires.noise and self._random.random() < wires.noise * STEP_S:
            a ^= 1
        return a, b

    def _look(self) -> None:
        """Decode the levels, where one can have changed."""
        quarters = [math.floor(shaft.place) for shaft in self.shafts]
        if quarters == self._quarters and not self._noisy:
            return
        self._quarters = quarters
        for name, decoder in self._decoders.items():
            if self.wires[name].slow_filter and self._random.random() < self.wires[name].slow_filter:
                continue
            decoder.see(*self._levels(name))

    def pulse(self, axis: str, duty: float, duration_s: float) -> PulseAnswer:
        assert abs(duty) <= 0.2 + 1e-9
        assert 0.0 < duration_s <= 0.03
        self.pulses.append((axis, duty, duration_s))
        wires = self.wires[axis]
        zero = {name: EncoderAnswer(0, 0, 0, 0) for name in self.wires}
        if wires.fault_line:
            return PulseAnswer(axis, duty, duration_s, 0.0, zero, (), fault=True)
        start = {n: (d.count, d.edges_a, d.edges_b, d.missed) for n, d in self._decoders.items()}
        positions, currents = [], []
        driven_s, tripped = 0.0, False
        for i in range(round(TRACE_S / STEP_S)):
            driven = i * STEP_S < duration_s - 1e-9 and not tripped
            if driven and wires.trips and duty != 0.0 and i * STEP_S > 0.002:
                tripped, driven = True, False
            sign = {"same": abs(duty), "forward": max(duty, 0.0)}.get(wires.lines, duty) * wires.sense
            driven_s += STEP_S * driven
            flowing = 0.0
            for number, shaft in enumerate(self.shafts):
                own = number == wires.motor
                if own and driven:
                    flowing = abs(shaft.step(sign, True))
                elif shaft.speed == 0.0:
                    continue
                else:
                    current = abs(shaft.step(0.0, False))
                    flowing = current if own else flowing
                far = abs(shaft.place - self._start[number])
                if far > self.furthest.get(number, 0.0):
                    self.furthest[number] = far
            self._look()
            if (i + 1) % 10 == 0:
                positions.append(self._decoders[axis].count - start[axis][0])
                if (i // 10) % 2 == 0:
                    currents.append(flowing + self._random.gauss(0.0, self.current_noise))
        answers = {
            n: EncoderAnswer(
                *(
                    now - then
                    for now, then in zip((d.count, d.edges_a, d.edges_b, d.missed), start[n], strict=True)
                )
            )
            for n, d in self._decoders.items()
        }
        return PulseAnswer(
            axis,
            duty,
            duration_s,
            driven_s,
            answers,
            tuple(positions),
            tripped,
            tuple(currents) if self.sensor else (),
        )

    def device(self, axis: str) -> ProvenDevice:
        return ProvenDevice("bench", "1")

    def notes(self, axis: str) -> tuple[str, ...]:
        return ()

    def counts(self, axis: str) -> int:
        return self._decoders[axis].count
