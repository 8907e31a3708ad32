"""Live streams of tendon robots: jerk and tensions hold in every tick; smooth paths are followed closely.

The tensions are compared with `PullLimits.excess`, the NumPy form of the limits, which the tick does not use.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from contid.control.tick.taut import lifted
from contid.kinematics.array import Array
from contid.kinematics.tendon.model import TendonModel
from contid.targets import Actuation, Target, Vec3
from contid.units import LIMIT_TOLERANCE_M
from tests.campaign.live.random_streams import rows_of as random_rows
from tests.campaign.live.random_streams import staged, violations
from tests.control.engine.streamed import Followed, Row, Run, rows_of

ROBOTS = ("tendon3", "ftdcr_v4")
#: Share of each tendon's travel in the middle of the reach.
MIDDLE = np.array([0.6, 0.45, 0.45] * 3)


def model_of(run: Run) -> TendonModel:
    model = run.config.model
    assert isinstance(model, TendonModel)
    return model


def answer(model: TendonModel, shares: Array) -> Actuation:
    low, high = np.array(model.lower), np.array(model.upper)
    asked = tuple((low + shares * (high - low)).tolist())
    return model.inverse(Target(actuation=asked), asked).actuation


def holds(run: Run, followed: Followed) -> bool:
    """Velocity, acceleration and jerk, and tension, travel and bends of every command."""
    model = model_of(run)
    over_m = max(float(model.excess(tuple(axes)).max()) for axes in followed.axes)
    return max(run.rates(followed)) <= 1.0 + 1e-6 and over_m <= 2.0 * LIMIT_TOLERANCE_M


def violent(model: TendonModel, seed: int, seconds: float) -> list[Row]:
    """Rows that jump, stop, restart and change their rate."""
    random, rows, now_s = np.random.default_rng(seed), list[Row](), 0.0
    while now_s < seconds:
        gap_s = float(random.choice([0.002, 0.01, 0.02, 0.1, 0.6]))
        spread = float(random.choice([0.0, 0.01, 0.2]))
        for _ in range(int(random.integers(1, 30))):
            shares = MIDDLE + spread * random.uniform(-1.0, 1.0, len(MIDDLE))
            rows.append((now_s, model.forward(answer(model, shares)).tip_m))
            now_s += gap_s
    return rows


@pytest.mark.parametrize("seed", [1, *(pytest.param(k, marks=pytest.mark.campaign) for k in range(4, 15))])
@pytest.mark.parametrize("name", ROBOTS)
def test_limits_hold_whatever_the_rows_do(name: str, seed: int) -> None:
    run = Run(name)
    model = model_of(run)
    run.at_rest_on(model.forward(answer(model, MIDDLE)).tip_m)
    followed = run.follow(violent(model, seed, 3.0), 3.0)
    assert holds(run, followed)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_smooth_path_has_no_corners(name: str) -> None:
    """The least tensions have one wherever another tendon becomes the slackest: 3 times the jerk."""
    run = Run(name)
    model = model_of(run)
    x, y, z = model.forward(answer(model, MIDDLE)).tip_m

    def at(time_s: float) -> Vec3:
        angle = 0.5 * math.pi * time_s
        return x + 0.005 * (math.cos(angle) - 1.0), y + 0.005 * math.sin(angle), z

    run.at_rest_on(at(0.0))
    followed = run.follow(list(rows_of(at, 50.0, 0.0)), 3.5)
    assert holds(run, followed)
    on = followed.time_s > 2.0
    assert not followed.limited[on].any()
    meant = np.array([at(time_s - 0.041) for time_s in followed.time_s[on]])
    assert np.linalg.norm(followed.tip_m[on] - meant, axis=1).max() < 1e-4


@pytest.mark.parametrize("name", ROBOTS)
def test_rows_that_jump_in_motion_are_arrived_at(name: str) -> None:
    run, random = Run(name), np.random.default_rng(2)
    model = model_of(run)
    run.at_rest_on(model.forward(answer(model, MIDDLE)).tip_m)
    jumps = [MIDDLE + 0.2 * random.uniform(-1.0, 1.0, len(MIDDLE)) for _ in range(8)]
    rows = [(0.13 * k, model.forward(answer(model, jump)).tip_m) for k, jump in enumerate(jumps)]
    followed = run.follow(rows, 4.0)
    assert holds(run, followed)
    assert math.dist(followed.tip_m[-1], rows[-1][1]) < 1e-9


@pytest.mark.parametrize("name", ROBOTS)
def test_a_lift_changes_tensions_not_bends(name: str) -> None:
    run, random = Run(name), np.random.default_rng(5)
    model, config = model_of(run), run.config
    assert model.taut is not None
    assert model.statics is not None
    for _ in range(30):
        pulls = answer(model, MIDDLE + 0.1 * random.uniform(-1.0, 1.0, len(MIDDLE)))
        higher = lifted(model.taut, config.lift_n, pulls)
        assert np.allclose(model.bends(higher), model.bends(pulls), atol=1e-12)
        rise_n = model.statics.tensions(np.array(higher)) - model.statics.tensions(np.array(pulls))
        assert rise_n.min() > -1e-9  # 0 where a tension is at its limit
        assert rise_n.max() > 0.0
        assert rise_n.max() < 0.2 * model.taut.range_n
        assert model.taut.excess(higher) == pytest.approx(float(model.excess(higher).max()), abs=1e-15)


@pytest.mark.parametrize("number", [6000070, 42000280])
def test_a_stop_is_the_one_that_was_compared_with_the_limits(number: int) -> None:
    """Rates that came to be parallel in it made it another one; between its states a tension was too low."""
    stage = staged("tendon3")
    assert violations(stage, random_rows(stage, number)) == {}  # 1.36 and 7.66 times the jerk before
