"""The way of a closing tip: its rates, its travel, and the forces that fit the currents of its axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.squeezing import Squeeze
from contid_contact.squeeze_force import fitting_n
from contid_contact.squeeze_way import device_turns, greatest_rate, moved, tip_travel_m
from tests.sense.squeeze_runs import RATE_HZ, hand

START, WAY = (0.060, 0.058), (0.010, -0.006)
NM_PER_A = 0.354


@pytest.fixture
def config() -> RobotConfig:
    return build_robot_configs(hand(3.0), RATE_HZ)[0]


def closing(goal_n: float = 3.0, share: float = 0.0) -> Squeeze:
    return Squeeze(goal_n, START, WAY, share=share)


def tip(config: RobotConfig, actuation: np.ndarray) -> np.ndarray:
    return np.array(config.model.forward(tuple(actuation.tolist())).tip_m)


@pytest.mark.parametrize("rate", [0.2, 2.0])
def test_the_share_keeps_the_rates_of_every_axis_and_arrives(config: RobotConfig, rate: float) -> None:
    squeeze, shares = closing(), [0.0]
    for _ in range(4000):
        squeeze = moved(config, squeeze, rate)
        shares.append(squeeze.share)
    assert max(shares) <= 1.0
    assert shares[-1] == pytest.approx(1.0, abs=1e-6)
    path = np.array(START) + np.outer(shares, WAY)
    for order, limits in ((1, np.array(config.velocity)), (2, np.array(config.acceleration))):
        most = np.abs(np.diff(path, n=order, axis=0)).max(axis=0) * RATE_HZ**order
        assert np.all(most <= limits * (1.0 + 1e-6))
    fastest = np.diff(shares).max() * RATE_HZ
    # A rate is reached to within half the change of a tick.
    change = min(np.array(config.acceleration) / np.abs(WAY)) / RATE_HZ
    assert 0.99 * rate <= fastest <= rate + 0.5 * change
    assert squeeze.reference == pytest.approx(np.add(START, WAY), abs=1e-7)


def test_no_goal_moves_an_axis_faster_than_its_velocity(config: RobotConfig) -> None:
    """But for half the change of one tick, as the acceleration ends in steps."""
    squeeze, slack = closing(), 1.0 + 0.5 * config.acceleration[0] / RATE_HZ / config.velocity[0]
    fastest = 0.0
    for _ in range(100):
        squeeze = moved(config, squeeze, 50.0)
        fastest = max(fastest, squeeze.rate)
    assert 0.99 < fastest / greatest_rate(config, squeeze) <= slack


def test_it_comes_back_to_the_start_and_no_further(config: RobotConfig) -> None:
    squeeze = closing(share=0.4)
    for _ in range(4000):
        squeeze = moved(config, squeeze, -0.5)
        assert squeeze.share >= 0.0
    assert squeeze.share == pytest.approx(0.0, abs=1e-6)
    assert squeeze.reference == pytest.approx(START, abs=1e-7)


def test_a_constant_rate_is_reached_exactly_and_kept(config: RobotConfig) -> None:
    squeeze = closing()
    for _ in range(400):
        squeeze = moved(config, squeeze, 0.1)
    assert squeeze.rate == 0.1
    before = squeeze.share
    assert moved(config, squeeze, 0.1).share == pytest.approx(before + 0.1 / RATE_HZ, rel=1e-12)


def test_the_greatest_rate_moves_the_fastest_axis_at_its_velocity(config: RobotConfig) -> None:
    rate = greatest_rate(config, closing())
    used = [rate * abs(part) / limit for part, limit in zip(WAY, config.velocity, strict=True)]
    assert max(used) == pytest.approx(1.0)
    second_only = replace(closing(), way=(0.0, 0.02))
    assert greatest_rate(config, second_only) == pytest.approx(config.velocity[1] / 0.02)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_the_travel_of_the_tip_is_that_of_the_model(config: RobotConfig, share: float) -> None:
    step = 1e-3
    ends = [tip(config, np.array(START) + (share + d) * np.array(WAY)) for d in (-step, step)]
    expected = float(np.linalg.norm(ends[1] - ends[0])) / (2.0 * step)
    assert tip_travel_m(config, closing(share=share)) == pytest.approx(expected, rel=1e-4)
    to_device = config.transmission.to_device
    turned = np.subtract(to_device(tuple(np.add(START, WAY).tolist())), to_device(START))
    assert device_turns(config, closing(share=share)) == pytest.approx(turned)


def needed_a(config: RobotConfig, squeeze: Squeeze, force_n: float) -> np.ndarray:
    """Currents that hold a force against the motion of the tip, by virtual work of every device."""
    at = np.array(squeeze.reference)
    along = tip(config, at + 1e-5 * np.array(squeeze.way)) - tip(config, at - 1e-5 * np.array(squeeze.way))
    along /= np.linalg.norm(along)
    device = np.array(config.transmission.to_device(tuple(at.tolist())))
    found = []
    for axis in range(len(at)):
        tips = []
        for turn in (-1e-4, 1e-4):
            shifted = device.copy()
            shifted[axis] += turn
            tips.append(tip(config, np.array(config.transmission.to_actuation(tuple(shifted.tolist())))))
        found.append(force_n * float((tips[1] - tips[0]) @ along) / 2e-4 / NM_PER_A)
    return np.array(found)


@pytest.mark.parametrize("force_n", [-2.0, 0.0, 0.5, 4.0])
def test_the_forces_that_fit_the_currents_are_within_friction(config: RobotConfig, force_n: float) -> None:
    squeeze = closing(share=0.3)
    currents = needed_a(config, squeeze, force_n)
    exact = replace(squeeze, currents=tuple(currents.tolist()), free=((0.0, 0.0), ()))
    assert fitting_n(config, exact) == pytest.approx((force_n, force_n), abs=0.02)
    friction = np.array([0.03, -0.05])
    loose = replace(exact, free=(tuple(friction.tolist()), ()))
    least, most = fitting_n(config, loose)
    assert least < force_n < most
    # At either end one axis needs all of its friction, and none needs more.
    for end in (least, most):
        used = np.abs(needed_a(config, squeeze, end) - currents) / np.abs(friction)
        assert used.max() == pytest.approx(1.0, abs=0.02)


def test_an_axis_that_moves_the_tip_across_its_way_does_not_count(config: RobotConfig) -> None:
    """Its current shows nothing of the force along the way."""
    start, step = np.array(START), 1e-5
    columns = np.array(
        [tip(config, start + step * each) - tip(config, start - step * each) for each in np.eye(2)]
    )
    x, y = columns[0, :2]
    way = 0.01 * np.linalg.solve(columns[:, :2].T, np.array([-y, x])) * step / np.hypot(x, y)
    squeeze = replace(closing(), way=tuple(way.tolist()))
    currents = needed_a(config, squeeze, 2.0)
    pushed = (currents[0] + 9.0, currents[1])
    found = fitting_n(config, replace(squeeze, currents=pushed, free=((0.0, 0.0), ())))
    assert found == pytest.approx((2.0, 2.0), rel=0.02)
