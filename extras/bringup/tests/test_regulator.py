"""Named faults of regulators, on chambers written apart: every name is right, and a healthy one has none."""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Callable

import pytest

from contid_bringup.regulator import RegulatorResult, bring_up_regulator
from contid_bringup.regulator_faults import Held, RegulatorFault, name_regulator_fault
from tests.support.air.chambers import Chambers, Regulator

MOST_PA = 1.5e5
X, Y = "arm.p0", "arm.p1"


def regulator(rng: random.Random, **wires: float | bool | None) -> Regulator:
    """Of the range of electronic regulators at soft chambers: 50 to 500 ms."""
    made = Regulator(rng.uniform(0.05, 0.5), rng.uniform(1e5, 1e6))
    return dataclasses.replace(made, **wires)  # type: ignore[arg-type]


def bench(rng: random.Random, **wires: float | bool | None) -> Chambers:
    return Chambers([regulator(rng, **wires), regulator(rng)])


def crossed(rng: random.Random, *, commands: bool) -> Chambers:
    exchanged = {0: 1, 1: 0}
    two = [regulator(rng), regulator(rng)]
    return Chambers(two, command_of=exchanged) if commands else Chambers(two, output_of=exchanged)


FAULTS = {
    "command open": (lambda r: bench(r, command_gain=0.0), RegulatorFault.NO_ANSWER),
    "output open": (lambda r: bench(r, output_v=0.0), RegulatorFault.NO_ANSWER),
    "output shorted to the supply": (lambda r: bench(r, output_v=10.0), RegulatorFault.READ_BACK_HIGH),
    "commands exchanged": (lambda r: crossed(r, commands=True), RegulatorFault.CROSSED),
    "outputs exchanged": (lambda r: crossed(r, commands=False), RegulatorFault.CROSSED),
    "0-10 V command at a 0-5 V output": (lambda r: bench(r, command_gain=0.5), RegulatorFault.HALF),
    "0-5 V command at a 0-10 V output": (lambda r: bench(r, command_gain=2.0), RegulatorFault.DOUBLE),
    "output of 5 V": (lambda r: bench(r, output_gain=0.5), RegulatorFault.HALF),
    "output of 4-20 mA": (lambda r: bench(r, output_gain=0.8, offset_v=2.0), RegulatorFault.AT_REST),
    "leak": (lambda r: bench(r, lag_s=0.3, leak=r.uniform(250.0, 600.0)), RegulatorFault.LEAK),
    "blocked exhaust": (lambda r: bench(r, blocked=True), RegulatorFault.NOT_VENTED),
}  # fmt: skip


def examine(made: Chambers) -> RegulatorResult:
    return bring_up_regulator(made, X, [Y], MOST_PA, made, lambda _line: None)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_has_its_name_at_a_fifth_of_the_pressure(fault: str) -> None:
    build, expected = FAULTS[fault]
    for seed in range(2):
        made = build(random.Random(seed))
        found = examine(made)
        assert found.fault is expected, (seed, made.regulators[0], found)
        assert made.highest_pa <= 0.2 * MOST_PA * (2.05 if expected is RegulatorFault.DOUBLE else 1.02)
        assert not made.enabled
        assert all("{" not in line for line in found.lines())
    if expected is RegulatorFault.CROSSED:
        assert found.other == Y


def test_a_healthy_regulator_has_no_fault_and_its_vent_is_timed() -> None:
    for seed in range(4):
        made = bench(random.Random(seed))
        found = examine(made)
        assert found.fault is RegulatorFault.NONE, found
        # A ramp of 2 bar/s over 0.3 bar, then the lag: at least 2.3 lags less the ramp.
        assert found.vent_s is not None
        assert 1.5 * made.regulators[0].lag_s < found.vent_s < 0.2 + 4.0 * made.regulators[0].lag_s


@dataclasses.dataclass
class Eye:
    """A person with a gauge of the truth, who opens a dump valve that works, does not, or is not there."""

    made: Chambers
    dump: bool | None

    def gauge_bar(self, axis: str, hold: Callable[[], object]) -> float | None:
        shown = 0.0
        for _ in range(400):
            hold()
            shown = max(shown, self.made.regulators[0].pressure_pa / 1e5)
        return shown

    def dumped(self, axis: str, hold: Callable[[], object]) -> bool:
        if self.dump:
            self.made.regulators[0].pressure_pa = 0.0
        return self.dump is not None


@pytest.mark.parametrize(
    ("wires", "dump", "name", "line"),
    [
        ({}, True, "ok", "gauge: 0.3 bar"),
        ({}, None, "ok", "gauge: 0.3 bar"),
        ({}, False, "does-not-dump", "dump valve open: 0.3 bar"),
        ({"command_gain": 0.5, "output_gain": 2.0}, None, "gauge-disagrees", "shows 50% of it"),
        ({"command_gain": 0.5}, None, "half-scale", "its pressure output is right, its command"),
        ({"output_gain": 0.5}, None, "half-scale", "its command is right, its pressure output"),
    ],
)
def test_a_gauge_shows_the_side_and_a_dump_valve_is_tried(
    wires: dict[str, float], dump: bool | None, name: str, line: str
) -> None:
    made = bench(random.Random(3), **wires)
    found = bring_up_regulator(made, X, [Y], MOST_PA, made, lambda _line: None, by_eye=Eye(made, dump))
    assert found.name == name
    assert any(line in each for each in found.lines()), found.lines()


def test_a_step_that_the_board_ended_is_never_right() -> None:
    held = [Held(1e4, 1e4, 1e4, {}), Held(2e4, 2e4, 2e4, {})]
    assert name_regulator_fault(held, stopped=True).fault is RegulatorFault.STOPPED
    assert name_regulator_fault(held, stopped=False).fault is RegulatorFault.NONE


@pytest.mark.campaign
def test_eleven_faults_on_25_plants_and_100_healthy_ones() -> None:
    wrong = [
        (fault, seed)
        for fault, (build, expected) in FAULTS.items()
        for seed in range(25)
        if examine(build(random.Random(seed))).fault is not expected
    ]
    assert len(wrong) <= 0.05 * 25 * len(FAULTS), wrong
    healthy = [examine(bench(random.Random(1000 + seed))).name for seed in range(100)]
    assert set(healthy) == {"ok"}
