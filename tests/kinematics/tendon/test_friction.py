"""Play and capstan against their definitions."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from contid.kinematics.tendon.friction import TendonPlay, capstan, play, play_series

VALUES = st.floats(-0.02, 0.02)
WIDTHS = st.floats(0.0, 0.003)


@given(st.lists(VALUES, min_size=1, max_size=30), WIDTHS)
def test_what_is_required_arrives(required, half_width):
    """The forward operator, driven by the inverse, delivers what is required from any start in its play."""
    state = TendonPlay.at((half_width,), (0.0,))
    delivered = 0.0
    for value in required:
        state = state.command((value,))
        delivered = float(play(state.commanded_m[0], delivered, half_width))
        assert abs(delivered - value) <= 1e-17 + 4e-16 * (abs(value) + half_width)


@given(VALUES, WIDTHS)
def test_asking_again_does_not_move(value, half_width):
    once = TendonPlay.at((half_width,), (0.001,)).command((value,))
    assert once.command((value,)).commanded_m == once.commanded_m


@given(st.lists(VALUES, min_size=2, max_size=30), WIDTHS)
def test_the_delivered_value_is_never_farther_than_the_play(commanded, half_width):
    series = np.array(commanded)
    delivered = play_series(series, half_width)
    assert np.abs(delivered - series).max() <= half_width + 1e-15
    moves = np.diff(delivered)
    # It moves only in the direction of the command's own step: no motion out of nothing.
    assert np.all(moves * np.diff(series) >= -1e-18)


def test_a_triangle_loses_twice_the_play():
    ramp = np.concatenate(
        (np.linspace(0, 0.01, 50), np.linspace(0.01, -0.01, 100), np.linspace(-0.01, 0.01, 100))
    )
    delivered = play_series(ramp, 0.002)
    assert np.max(delivered) == 0.01 - 0.002
    assert np.min(delivered) == -0.01 + 0.002


def test_no_play_is_the_identity():
    state = TendonPlay.at((0.0, 0.0), (0.0, 0.0)).command((0.004, -0.003))
    assert state.commanded_m == (0.004, -0.003)


def test_capstan_solves_its_differential_equation():
    mu, theta = 0.2, 1.7
    for sliding in (1.0, -1.0):
        loss = -mu * sliding
        integrated = solve_ivp(lambda _, t, loss=loss: loss * t, (0, theta), [10.0], rtol=1e-10).y[0, -1]
        assert math.isclose(float(capstan(10.0, theta, mu, sliding)), integrated, rel_tol=1e-8)
    assert float(capstan(10.0, theta, mu, 0.0)) == 10.0
