"""Backlash from pulses: a gear with a gap, whose encoder is behind it, written apart."""

from __future__ import annotations

import random

import pytest

from contid.hal.pulses import EncoderAnswer
from contid_bringup.backlash import measure_backlash
from contid_devices.pulsed_motors import DriveFacts, PulseAnswer
from tests.support.shafts.shaft_plant import STEP_S, TRACE_S, Shaft

PER_DEG = 4776 / 360.0


class LooseGear:
    """The motor pushes the output at either edge of a gap; the output stays where it was left."""

    def __init__(self, shaft: Shaft, gap: float) -> None:
        self.shaft, self.gap = shaft, gap
        self.output = shaft.place - gap * 0.3

    def pulse(self, duty: float, duration_s: float) -> PulseAnswer:
        start, positions = int(self.output // 1), []
        for i in range(round(TRACE_S / STEP_S)):
            self.shaft.step(duty, i * STEP_S < duration_s - 1e-9)
            self.output = min(max(self.output, self.shaft.place - self.gap), self.shaft.place)
            if (i + 1) % 10 == 0:
                positions.append(int(self.output // 1) - start)
        own = EncoderAnswer(positions[-1], abs(positions[-1]), abs(positions[-1]), 0)
        return PulseAnswer("arm.x", duty, duration_s, duration_s, {"arm.x": own}, tuple(positions))


@pytest.mark.parametrize("gap_deg", [0.0, 0.15, 0.4, 1.0])
def test_the_gap_is_found_within_its_deviation(gap_deg: float) -> None:
    for seed in range(3):
        rng = random.Random(f"{gap_deg} {seed}")
        shaft = Shaft(
            no_load=rng.uniform(6000.0, 9000.0),
            tau=rng.uniform(0.02, 0.08),
            friction=rng.uniform(0.03, 0.1),
            brakes=rng.random() < 0.5,
            place=rng.uniform(0.0, 50.0),
        )
        facts = DriveFacts(4776.0, shaft.brakes, shaft.friction, shaft.no_load / PER_DEG, shaft.tau)
        found = measure_backlash(LooseGear(shaft, gap_deg * PER_DEG).pulse, facts)
        assert found is not None
        assert found.deviation <= 0.05
        assert found.value == pytest.approx(gap_deg, abs=3.0 * found.deviation)


def test_a_gap_wider_than_a_pulse_is_not_stated() -> None:
    facts = DriveFacts(4776.0, True, 0.05, 575.0, 0.04)
    assert measure_backlash(LooseGear(Shaft(), 30.0 * PER_DEG).pulse, facts) is None
