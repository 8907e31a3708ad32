"""A straight stop: its velocity is that of its positions, also at an end of an axis."""

from __future__ import annotations

import numpy as np
import pytest

from contid.trajectory.straight_stop import StraightStop

PERIOD_S = 0.01


def test_an_axis_at_its_end_rests_while_the_other_goes_on() -> None:
    stop = StraightStop((0.99, 0.5), (0.01, 0.005), (0.001, 0.001), ((0.0, 1.0), (0.0, 1.0)), PERIOD_S)
    states = [stop.at(tick * PERIOD_S) for tick in range(12)]
    positions = np.array([state.position for state in states])
    velocities = np.array([state.velocity for state in states])
    assert positions.max(axis=0).tolist() == [1.0, 0.5225]
    assert (velocities[2:, 0] == 0.0).all()
    assert (velocities[:9, 1] > 0.0).all()
    # The velocity of a tick is that of the steps before and after it, to half a change of the step.
    means = (positions[1:] - positions[:-1]) / PERIOD_S
    assert np.abs(means[:8, 1] - velocities[:8, 1]).max() < 0.11


@pytest.mark.parametrize("change", [0.0, -1.0, float("nan")])
def test_a_change_that_stops_nothing_is_refused(change: float) -> None:
    with pytest.raises(ValueError, match="changes: above 0"):
        StraightStop((0.0,), (1.0,), (change,), ((0.0, 1.0),), PERIOD_S)
