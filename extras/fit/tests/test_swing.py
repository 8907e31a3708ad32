"""The amplitude by which a body may swing, beside an integration of its equation and the moving twin."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from contid_fit.sense.live.innovation_test import NEWEST, REFERENCE, InnovationTest, TipResidual
from contid_fit.sense.live.swing import _FACTOR, BodySwing, swing_of
from tests.sense.plant import shipped_robot

BY_PRESSURE = np.array([[50.0, 0.0], [0.0, 20.0], [0.0, 0.0]])  # mm/bar


def test_it_is_the_envelope_of_a_swing_about_an_equilibrium_that_moves() -> None:
    """A pressure that goes up by 0.4 bar in 0.4 s; the oscillator in full, by scipy."""
    rate, damping_s = 2.0 * math.pi * 2.0, 8e-3
    ratio = 0.5 * rate * damping_s

    def rates(t: float, state: list[float]) -> list[float]:
        speed = 50.0 if t < 0.4 else 0.0
        off = 50.0 * min(t, 0.4) - state[0]
        return [state[1], rate**2 * off + 2.0 * ratio * rate * (speed - state[1])]

    times = np.arange(0.02, 3.0, 0.02)
    tip = solve_ivp(rates, (0.0, 3.0), [0.0, 0.0], t_eval=times, max_step=0.005, rtol=1e-9).y[0]
    swing = BodySwing((2.0, 2.0001), damping_s, 0.0)
    swing.to(0.0, np.zeros(2), BY_PRESSURE)
    found = [swing.to(t, np.array([min(t, 0.4), 0.0]), BY_PRESSURE) / _FACTOR for t in times]
    about = np.abs(tip - 50.0 * np.minimum(times, 0.4))
    late = times > 0.5
    for begin in range(25, 100, 25):
        period = slice(begin, begin + 26)
        assert max(found[period]) == pytest.approx(about[period].max(), rel=0.2)
    assert np.all(np.array(found)[late] > 0.98 * about[late])


def test_a_detector_that_begins_during_a_swing_has_all_of_it() -> None:
    """It was armed when the load was known, seconds after a motion: a false contact once."""
    sees_all, begins = BodySwing((1.5, 3.0), 8e-3, 0.3), BodySwing((1.5, 3.0), 8e-3, 0.3)
    for k in range(100):
        pressures = np.array([min(0.02 * k, 0.4), 0.0])
        sees_all.to(0.02 * k, pressures, BY_PRESSURE)
    begins.go_on_from(sees_all)
    assert begins.to(1.98, pressures, BY_PRESSURE) == sees_all.amplitude_mm > 3.0  # the newest was seen
    assert begins.to(2.0, pressures, BY_PRESSURE) == sees_all.to(2.0, pressures, BY_PRESSURE)


def test_an_arm_without_dynamics_does_not_swing() -> None:
    robot = shipped_robot().model_copy(update={"dynamics": None})
    assert swing_of(robot).to(0.0, np.ones(6), np.ones((3, 6))) == 0.0


@pytest.mark.parametrize(("swing_mm", "found"), [(0.0, True), (8.0, False)])
def test_a_shift_within_the_swing_is_no_contact(swing_mm: float, found: bool) -> None:
    test, rng = InnovationTest(0.3), np.random.default_rng(2)
    seen = []
    for k in range(NEWEST + REFERENCE + 4):
        shift = 4.0 if k >= NEWEST + REFERENCE else 0.0
        residual = rng.normal((shift, 0.0, 0.0), 0.3)
        flat = np.zeros((3, 3))
        seen.append(test.add(TipResidual(residual, np.zeros(3), np.ones((3, 6)), flat, flat, flat, swing_mm)))
    assert any(each is not None for each in seen) is found


@pytest.mark.campaign
def test_a_swinging_arm_touches_nothing() -> None:
    from tests.sense.swinging import swings

    contacts, looked, _ = swings(0, 0.5)
    assert contacts == 0
    assert looked > 0.9
