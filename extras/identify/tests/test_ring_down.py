"""Frequency and damping of free swings: of oscillators by the matrix exponential, and of the moving twin."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.robot_file.load import load_named
from contid_dynamics.arm import MovingArm
from contid_dynamics.report import pose_modes
from contid_identify.ring_down import Decay, fit_ring_downs

NOISE_M = 0.3e-3
PERIOD_S = 0.01


def swinging(hz: float, ratio: float, size_m: float, count: int = 300) -> Array:
    """A mass on a spring and a damper, let go: positions at 100 Hz by the matrix exponential."""
    rate = 2.0 * math.pi * hz / math.sqrt(1.0 - ratio**2)  # hz: damped
    step = expm(np.array([[0.0, 1.0], [-(rate**2), -2.0 * ratio * rate]]) * PERIOD_S)
    state, out = np.array([size_m, 0.0]), []
    for _ in range(count):
        out.append(state[0])
        state = step @ state
    return np.array(out)


def decay(tip_m: Array, command: float = 0.0) -> Decay:
    return Decay(0.0, np.arange(float(len(tip_m))) * PERIOD_S, tip_m, 0.05, np.array([command]), 0.02)


def noisy(seed: int, *columns: Array) -> Array:
    noise = np.random.default_rng(seed).normal(size=(len(columns[0]), 3)) * NOISE_M
    noise[:, : len(columns)] += np.column_stack(columns)
    return noise


def test_one_mode_is_found() -> None:
    (found,) = fit_ring_downs([decay(noisy(k, swinging(2.5, 0.29, 0.03))) for k in range(3)])
    (mode,) = found.modes
    assert mode.frequency_hz.value == pytest.approx(2.5, rel=0.02)
    assert mode.ratio.value == pytest.approx(0.29, rel=0.1)
    assert found.noise_m == pytest.approx(NOISE_M, rel=0.1)


def test_two_modes_are_separated_the_stronger_first() -> None:
    parts = swinging(7.0, 0.05, 0.004), swinging(1.8, 0.08, 0.02)
    (found,) = fit_ring_downs([decay(noisy(1, *parts))])
    hz = [mode.frequency_hz.value for mode in found.modes]
    assert hz == pytest.approx([1.8, 7.0], rel=0.01)
    assert [mode.ratio.value for mode in found.modes] == pytest.approx([0.08, 0.05], rel=0.2)


@pytest.mark.parametrize("seeds", [10, pytest.param(40, marks=pytest.mark.campaign)])
def test_intervals_hold(seeds: int) -> None:
    held = 0
    for seed in range(seeds):
        (found,) = fit_ring_downs([decay(noisy(seed, swinging(3.0, 0.1, 0.02)))])
        interval = found.modes[0].frequency_hz
        held += interval.low <= 3.0 <= interval.high
    assert 0.85 * seeds <= held <= seeds


def test_poses_are_apart() -> None:
    two = [decay(noisy(1, swinging(2.0, 0.1, 0.02))), decay(noisy(2, swinging(4.0, 0.1, 0.02)), 1.0)]
    assert sorted(each.modes[0].frequency_hz.value for each in fit_ring_downs(two)) == pytest.approx(
        [2.0, 4.0], rel=0.01
    )


def test_no_decay_is_an_error_with_the_remedy() -> None:
    with pytest.raises(ContidError, match="contid excite --part ring-downs"):
        fit_ring_downs([])


@pytest.mark.parametrize("pressures_pa", [(3e4,) * 6, (6e4, 2e4, 2e4, 2e4, 2e4, 2e4)])
def test_the_moving_twin_at_a_trackers_noise(pressures_pa: tuple[float, ...]) -> None:
    """Modes are those of the linearised body, computed without a motion."""
    (robot,) = load_named("stiffflop2").driven.values()
    arm = MovingArm(robot)
    arm.settle([each + extra for each, extra in zip(pressures_pa, (1e4, 0, 0, 0, 0, 0), strict=True)])
    arm.command(pressures_pa)
    tips = arm.tips_of(arm.rod.run(4.0, 1e-3, every=10)[:, 0])
    truth = pose_modes(robot, pressures_pa, 2).modes
    (found,) = fit_ring_downs([decay(noisy(5, *tips.T))])
    mode = found.modes[0]
    nearest = min(truth, key=lambda each: abs(each.frequency_hz - mode.frequency_hz.value))
    assert mode.frequency_hz.value == pytest.approx(nearest.frequency_hz, rel=0.02)
    assert mode.ratio.value == pytest.approx(nearest.ratio, rel=0.2)
