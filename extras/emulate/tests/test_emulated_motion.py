"""Bodies in motion on emulated servos, in virtual time: what trackers and currents show of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contid.control.engine.wiring import wired_buses
from contid.kinematics.array import Array
from contid.robot_file.load import LoadedFile, load_named, parse_robot_file
from contid_drivers.dynamixel import registers as reg
from contid_emulate.bodies import EmulatedBodies
from contid_emulate.dynamixel.bench import Bench

SIM = "sim: {dynamics: true, tracker: {noise_mm: 0, rate_hz: 200, latency_ms: 0}}"
LOOK_S = 0.004
#: Radius of the spools and of the circle of tendons [m]; stiffness of the rod [N m2].
SPOOL, CIRCLE, ROD = 0.010, 0.008, 2945e-6
#: Lengths of the rod before the section, of the section, of the tip [m].
BASE, SECTION, TIP = 0.010, 0.120, 0.005
MA_PER_NM = 1470.0 / 0.52


def moving(damping_ms: int = 3, more: str = "") -> LoadedFile:
    text = load_named("bend1.emulated").text.replace("    rates:", f"    {SIM}\n    rates:", 1)
    return parse_robot_file(text.replace("damping_ms: 3", f"damping_ms: {damping_ms}{more}"), "bend1.yaml")


class Rig:
    """Servos with a body; they take goals at once, as from a host."""

    def __init__(self, loaded: LoadedFile) -> None:
        (bus,) = wired_buses(loaded)
        self.bench = Bench(bus.wiring.name, bus.wiring.options, bus.axes)  # type: ignore[arg-type]
        self.servos = self.bench.emulator.servos
        self.bodies = EmulatedBodies(loaded, {bus.wiring.name: self.bench}, 0.0)
        self.now_s = 0.0
        self.tips: list[tuple[float, ...]] = []
        self.currents: list[list[float]] = []
        for servo in self.servos:
            servo.put(reg.OPERATING_MODE, 4)
            servo.put(reg.TORQUE_ENABLE, 1)

    def go(self, pulls_mm: list[float], seconds: float) -> None:
        for servo, pull in zip(self.servos, pulls_mm, strict=True):
            servo.motion.goal = pull * 1e-3 / SPOOL / reg.RAD_PER_TICK
        for _ in range(round(seconds / LOOK_S)):
            self.now_s += LOOK_S
            for tip in self.bodies.advance(self.now_s):
                self.tips.append((tip.time_s, *tip.tip_in_world_m))
            self.currents.append([servo.motion.current for servo in self.servos])

    def tip(self, from_s: float) -> Array:
        return np.array([row for row in self.tips if row[0] >= from_s])


def bent(pull_mm: float) -> list[float]:
    """A bend towards the first tendon."""
    return [pull_mm * math.cos(math.radians(angle)) for angle in (0, 120, 240)]


def swing_hz(times: Array, values: Array) -> float:
    """By its crossings of its mean."""
    about = values - values.mean()
    crossings = times[:-1][np.diff(np.sign(about)) != 0]
    return float((len(crossings) - 1) / (2.0 * (crossings[-1] - crossings[0])))


def test_tracker_and_currents_show_the_swing_of_a_guided_beam() -> None:
    """Tendons hold the end's angle: a mass on a beam that is guided, with 13/35 of the beam's own mass."""
    rig = Rig(moving(3, "\n      tip_mass_g: 200"))
    rig.go(bent(1.0), 1.8)
    mass_kg = 0.200 + 13.0 / 35.0 * 0.040 * SECTION
    beam_hz = math.sqrt(12.0 * ROD / SECTION**3 / mass_kg) / math.tau
    rows, currents = rig.tip(0.4), np.array(rig.currents)[100:, 0]
    assert np.ptp(rows[:, 1]) > 5e-3
    assert swing_hz(rows[:, 0], rows[:, 1]) == pytest.approx(beam_hz, rel=0.04)
    times = LOOK_S * np.arange(len(currents), dtype=np.float64)
    assert swing_hz(times, currents) == pytest.approx(beam_hz, rel=0.04)
    assert np.ptp(currents) > 5.0


def test_at_rest_the_tip_and_the_currents_are_those_of_a_bent_rod() -> None:
    """Moments about the end: r (T1 - (T2 + T3) / 2) = EI angle / L, with three floors in all."""
    rig = Rig(moving(30))
    rig.go(bent(1.0), 8.0)
    angle = 1e-3 / CIRCLE
    differs_n = ROD * angle / SECTION / CIRCLE
    tensions_n = [1.0 + 2.0 / 3.0 * differs_n, *(2 * [1.0 - differs_n / 3.0])]
    assert rig.currents[-1] == pytest.approx([MA_PER_NM * SPOOL * each for each in tensions_n], abs=0.3)
    *_, x, y, z = rig.tips[-1]
    radius = SECTION / angle
    assert x == pytest.approx(radius * (1.0 - math.cos(angle)) + TIP * math.sin(angle), abs=1e-4)
    assert z == pytest.approx(BASE + radius * math.sin(angle) + TIP * math.cos(angle), abs=1e-4)
    assert y == pytest.approx(0.0, abs=1e-9)


def test_two_emulations_in_virtual_time_are_the_same_to_the_bit() -> None:
    rigs = [Rig(moving()) for _ in range(2)]
    for rig in rigs:
        rig.go(bent(2.0), 0.3)
    assert len(rigs[0].tips) > 50
    assert rigs[0].tips == rigs[1].tips
    assert rigs[0].currents == rigs[1].currents


def test_the_dead_time_is_between_the_shaft_and_the_body() -> None:
    began = []
    for delay_ms in (0, 80):
        rig = Rig(moving(3, f"\n      delay_ms: [{delay_ms}]"))
        rig.go(bent(1.0), 0.3)
        rows = rig.tip(0.0)
        began.append(float(rows[np.flatnonzero(rows[:, 1] > 2e-3)[0], 0]))
    assert began[1] - began[0] == pytest.approx(0.080, abs=0.006)


def test_a_snapped_tendon_neither_loads_its_servo_nor_bends_the_body() -> None:
    rig = Rig(moving(30))
    (plant,) = rig.bench.emulator.tendons
    plant.snap(0)
    rig.go(bent(1.0), 1.0)
    assert rig.currents[-1][0] == 0.0
    assert rig.tips[-1][1] < 0.0  # the two others pull it over


def test_a_body_needs_all_of_its_buses() -> None:
    loaded = moving()
    bodies = EmulatedBodies(loaded, {}, 0.0)
    assert not bodies
    assert bodies.lines == []
    other = EmulatedBodies(loaded, {"servos": object()}, 0.0)
    assert not other
    assert other.lines == ["arm: no body, since bus servos is not emulated here"]
