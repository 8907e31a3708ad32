"""Friction, top speed and time constant of servos from counts with times of whole milliseconds."""

from __future__ import annotations

import math
import random

import pytest

from contid.hal.pulses import EncoderAnswer
from contid_bringup.drive_fit import measure
from contid_bringup.timed_fit import fit_timed
from contid_devices.pulsed_motors import DriveFacts, PulseAnswer, TimedCount
from tests.support.shafts.shaft_plant import STEP_S, Shaft

TICKS_PER_DEG = 4096 / 360.0


def pulse(shaft: Shaft, rng: random.Random, duty: float, duration_s: float) -> PulseAnswer:
    """A servo that begins up to 10 ms late, and is read every 1 to 4 ms; its clock has whole milliseconds."""
    start, clock_s = shaft.place, rng.uniform(0.0, 0.01)
    began_s, look_s = clock_s + rng.uniform(0.0, 0.01), clock_s
    timed, first_s = [], math.floor(clock_s * 1000.0) / 1000.0
    while clock_s < began_s + duration_s:
        shaft.step(duty if clock_s >= began_s else 0.0, True)
        clock_s += STEP_S
        if clock_s >= look_s:
            look_s = clock_s + rng.uniform(0.001, 0.004)
            way = round(shaft.place) - round(start)
            timed.append(TimedCount(math.floor(clock_s * 1000.0) / 1000.0 - first_s, way))
    while shaft.speed:
        shaft.step(0.0, True)
    way = round(shaft.place) - round(start)
    seen = {"arm.x": EncoderAnswer(way, abs(way), abs(way), 0)}
    return PulseAnswer("arm.x", duty, duration_s, duration_s, seen, (way,) * 40, timed=tuple(timed))


@pytest.mark.parametrize("seed", range(4))
def test_numbers_of_a_servo_are_found_from_a_wrong_guess(seed: int) -> None:
    rng = random.Random(seed)
    top_deg_s = rng.uniform(180.0, 800.0)
    true = Shaft(top_deg_s * TICKS_PER_DEG, rng.uniform(0.01, 0.05), rng.uniform(0.02, 0.07))
    facts = DriveFacts(4096, True, 0.05, top_deg_s * rng.uniform(0.7, 1.3), 0.03, sealed=True, longest_s=0.25)
    answers = measure(lambda duty, seconds: pulse(true, rng, duty, seconds), true.friction + 0.03, facts)
    assert max(abs(answer.own.counts) for answer in answers) < 12.0 * TICKS_PER_DEG
    found = fit_timed(answers, facts)
    assert found is not None
    assert found.friction.value == pytest.approx(true.friction, rel=0.05)
    assert found.no_load_deg_s.value == pytest.approx(top_deg_s, rel=0.05)
    assert found.time_constant_s.value == pytest.approx(true.tau, rel=0.1)


def test_too_few_timed_pulses_show_nothing() -> None:
    facts = DriveFacts(4096, True, 0.05, 600.0, 0.03, sealed=True)
    assert fit_timed([], facts) is None
