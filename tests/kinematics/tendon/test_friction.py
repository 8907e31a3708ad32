"""The play operator against its definition."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from contid_fit.calibrate.tendon.play_series import play_series

VALUES = st.floats(-0.02, 0.02)
WIDTHS = st.floats(0.0, 0.003)


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
