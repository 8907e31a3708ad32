"""Named faults of wiring on shafts written apart: every name is right, and a healthy motor has none."""

from __future__ import annotations

import random

import pytest

from contid_bringup.naming import Verdict, name_fault
from contid_bringup.probing import DUTY_MOST, probe
from contid_bringup.wiring_faults import WiringFault
from contid_devices.pulsed_motors import DriveFacts
from tests.support.shafts.shaft_plant import Bench, Shaft, Wires

X, Y = "arm.x", "arm.y"
COUNTS_PER_DEG = 4776 / 360.0


def plant(rng: random.Random, most_friction: float = 0.14) -> Shaft:
    """A motor of the range that pulses of 20 % can turn: friction 2 to 14 %, time constant 10 to 200 ms."""
    return Shaft(
        no_load=rng.uniform(4000.0, 12000.0),
        tau=10.0 ** rng.uniform(-2.0, -0.7),
        friction=rng.uniform(0.02, most_friction),
        stiction=rng.uniform(1.0, 1.25),
        brakes=rng.random() < 0.7,
        place=rng.uniform(0.0, 4.0),
    )


def bench(rng: random.Random, sensor: bool = False, **wires: object) -> Bench:
    two = {X: Wires(shaft=0, **wires), Y: Wires(shaft=1)}  # type: ignore[arg-type]
    return Bench([plant(rng), plant(rng)], two, seed=rng.randrange(2**32), sensor=sensor)


def crossed_motors(rng: random.Random) -> Bench:
    made = bench(rng, motor=1)
    made.wires[Y].motor = 0
    return made


def crossed_encoders(rng: random.Random) -> Bench:
    made = bench(rng, track_a=(1, "a"), track_b=(1, "b"))
    made.wires[Y].track_a, made.wires[Y].track_b = (0, "a"), (0, "b")
    return made


def crossed_track(rng: random.Random) -> Bench:
    made = bench(rng, track_a=(1, "a"))
    made.wires[Y].track_a = (0, "a")
    return made


def standing(rng: random.Random, sensor: bool) -> Bench:
    made = bench(rng, sensor)
    made.shafts[0].stuck = True
    return made


def unconnected(rng: random.Random, sensor: bool) -> Bench:
    made = bench(rng, sensor)
    made.shafts[0].connected = False
    return made


def stiff(rng: random.Random) -> Bench:
    made = bench(rng)
    made.shafts[0].friction = rng.uniform(0.2, 0.3)
    return made


def dead_encoder_with_sensor(rng: random.Random) -> Bench:
    made = bench(rng, True, track_a=(0, "open"), track_b=(0, "open"))
    made.shafts[0].tau = rng.uniform(0.01, 0.08)
    made.shafts[0].friction = rng.uniform(0.02, 0.1)
    return made


OPEN = (0, "open")
#: What is wrong, and the names that are right for it.
FAULTS = {
    "motor reversed": (lambda r: bench(r, sense=-1), WiringFault.REVERSED),
    "tracks swapped": (lambda r: bench(r, track_a=(0, "b"), track_b=(0, "a")), WiringFault.REVERSED),
    "track A open": (lambda r: bench(r, track_a=OPEN), WiringFault.TRACK_A),
    "track B open": (lambda r: bench(r, track_b=OPEN), WiringFault.TRACK_B),
    "encoder dead": (lambda r: bench(r, track_a=OPEN, track_b=OPEN), WiringFault.NO_COUNT),
    "encoder dead, current sensor": (dead_encoder_with_sensor, WiringFault.DEAD_ENCODER),
    "encoders swapped": (crossed_encoders, WiringFault.CROSSED_AXES),
    "motors swapped": (crossed_motors, WiringFault.CROSSED_AXES),
    "one track swapped with the other axis": (crossed_track, WiringFault.CROSSED_TRACK),
    "tracks joined": (lambda r: bench(r, track_b=(0, "a")), WiringFault.TRACKS_TOGETHER),
    "fault line low": (lambda r: bench(r, fault_line=True), WiringFault.FAULT_LINE),
    "bridge trips": (lambda r: bench(r, trips=True), WiringFault.BRIDGE_TRIPS),
    "shaft stuck": (lambda r: standing(r, False), WiringFault.NO_COUNT),
    "shaft stuck, current sensor": (lambda r: standing(r, True), WiringFault.NO_MOTION),
    "motor open": (lambda r: unconnected(r, False), WiringFault.NO_COUNT),
    "motor open, current sensor": (lambda r: unconnected(r, True), WiringFault.NO_CURRENT),
    "friction of 20 to 30 %": (stiff, WiringFault.NO_COUNT),
    "line for one direction open": (lambda r: bench(r, lines="forward"), WiringFault.ONE_DIRECTION),
    "direction line open": (lambda r: bench(r, lines="same"), WiringFault.SAME_DIRECTION),
    "noise on track A": (lambda r: bench(r, noise=300.0), WiringFault.UNDRIVEN),
}  # fmt: skip


def examine(made: Bench) -> Verdict:
    """Pulses and verdict of the first axis."""
    stall_a = made.shafts[0].stall_a if made.sensor else 0.0
    return name_fault(probe(lambda duty, seconds: made.pulse(X, duty, seconds), facts(made)), stall_a)


def facts(made: Bench) -> DriveFacts:
    """A robot file of the motor that is driven, whose numbers are wrong by up to 30 %."""
    rng, shaft = random.Random(made.seed), made.shafts[made.wires[X].motor]
    return DriveFacts(
        4776.0,
        shaft.brakes,
        shaft.friction * rng.uniform(0.7, 1.3),
        shaft.no_load / COUNTS_PER_DEG * rng.uniform(0.7, 1.3),
        shaft.tau * rng.uniform(0.7, 1.3),
    )


def furthest_deg(made: Bench) -> float:
    """How far any shaft went from its start."""
    return max(made.furthest.values(), default=0.0) / COUNTS_PER_DEG


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_has_its_name_within_two_degrees(fault: str) -> None:
    build, expected = FAULTS[fault]
    for seed in range(1):
        made = build(random.Random(seed))
        verdict = examine(made)
        assert verdict.fault is expected, (seed, made.shafts[0])
        assert furthest_deg(made) <= 2.0
        assert all(abs(duty) <= DUTY_MOST for _, duty, _ in made.pulses)
        assert verdict.message
        assert verdict.remedy
    if expected in (WiringFault.CROSSED_AXES, WiringFault.CROSSED_TRACK):
        assert verdict.other == Y


def test_a_healthy_motor_has_no_fault() -> None:
    for seed in range(4):
        assert examine(bench(random.Random(seed))).fault is WiringFault.NONE, seed


def run_campaign(plants: int, healthy: int) -> tuple[dict[str, int], dict[str, int], float]:
    """Right names by fault, names of healthy motors, and the longest way [deg]."""
    right: dict[str, int] = {}
    longest = 0.0
    for fault, (build, expected) in FAULTS.items():
        right[fault] = 0
        for seed in range(plants):
            made = build(random.Random(1000 + seed))
            right[fault] += examine(made).fault is expected
            longest = max(longest, furthest_deg(made))
    names: dict[str, int] = {}
    for seed in range(healthy):
        made = bench(random.Random(50_000 + seed))
        name = examine(made).fault.value
        names[name] = names.get(name, 0) + 1
        longest = max(longest, furthest_deg(made))
    return right, names, longest


@pytest.mark.campaign
@pytest.mark.timeout(3600)
def test_twenty_faults_on_25_plants_and_500_healthy_ones() -> None:
    right, names, longest = run_campaign(25, 500)
    assert sum(right.values()) >= 0.95 * 25 * len(right), right
    assert longest <= 2.0
    assert set(names) <= {"ok", WiringFault.NO_COUNT.value}, names
