"""A closing tip: when it moves, what counts as a touch, when its force is reached or lost."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.squeezing import Squeeze, SqueezeEnd
from contid.control.tick.state import OrderRefusedError, RobotState
from contid.control.tick.supervisor import Mode
from contid.control.tick.transitions import goto
from contid.hal import Sample
from contid.targets import Target
from contid_contact.squeeze import _held, _touching, next_squeeze, why_not
from contid_contact.squeeze_force import CLOSING_M_S
from contid_contact.squeeze_way import greatest_rate, tip_travel_m
from tests.sense.squeeze_runs import RATE_HZ, hand

START, WAY = (0.060, 0.058), (0.010, -0.006)


@pytest.fixture
def config() -> RobotConfig:
    return build_robot_configs(hand(3.0), RATE_HZ)[0]


def closing(goal_n: float = 3.0, share: float = 0.0) -> Squeeze:
    return Squeeze(goal_n, START, WAY, share=share)


def samples(*currents: float | None) -> list[Sample]:
    return [Sample(0.0, 0.0, True, 0.0, effort=each) for each in currents]


def test_without_a_current_of_every_axis_it_stops(config: RobotConfig) -> None:
    squeeze = closing()
    for _ in range(100):
        squeeze, report = next_squeeze(config, squeeze, samples(0.04, -0.02))
        assert report is None
    assert squeeze.rate > 0.0
    for _ in range(200):
        squeeze, report = next_squeeze(config, squeeze, samples(0.04, None))
        assert report is None
    assert squeeze.rate == 0.0


def test_the_tip_closes_at_its_speed_whatever_the_length_of_the_way(config: RobotConfig) -> None:
    for scale in (0.5, 1.0, 2.0):
        squeeze = replace(closing(), way=tuple(scale * part for part in WAY))
        for _ in range(60):
            squeeze, _ = next_squeeze(config, squeeze, samples(0.04, -0.02))
        assert squeeze.rate * tip_travel_m(config, squeeze) == pytest.approx(CLOSING_M_S, rel=0.02)


def test_a_touch_measures_the_stiffness_between_half_of_it_and_all(config: RobotConfig) -> None:
    """An object of 400 N/m: the force grows with the way of the tip behind its surface."""
    travel_m, goal_n, stiffness = 0.02, 3.0, 400.0
    squeeze = closing(goal_n, share=0.2)
    for k in range(1000):
        share = 0.2 + 2e-4 * k
        force_n = stiffness * max(0.0, (share - 0.25) * travel_m)
        squeeze = _touching(replace(squeeze, share=share, force_n=force_n), travel_m)
        if share < 0.25:
            assert squeeze.touched is None
        if force_n < 0.29 * goal_n:
            assert squeeze.stiffness == 0.0
    assert squeeze.stiffness == pytest.approx(stiffness * travel_m, rel=0.02)
    assert squeeze.touched == pytest.approx(0.25 + 0.15 * goal_n / stiffness / travel_m, abs=3e-4)
    first = squeeze
    assert _touching(replace(squeeze, force_n=10.0 * goal_n), travel_m).stiffness == first.stiffness


def test_half_a_touch_that_goes_away_was_none(config: RobotConfig) -> None:
    squeeze = _touching(replace(closing(3.0, share=0.2), force_n=0.5), 0.02)
    assert squeeze.touched == 0.2
    assert _touching(replace(squeeze, force_n=0.1), 0.02).touched is None


@pytest.mark.parametrize(("stiffness", "kept"), [(5.0, 20.0), (1e6, 1e4)])
def test_the_stiffness_has_bounds(config: RobotConfig, stiffness: float, kept: float) -> None:
    goal_n, travel_m = 3.0, 0.02
    touch_n = 0.3 * goal_n
    squeeze = replace(closing(goal_n, share=0.5), touched=0.5 - 0.5 * touch_n / stiffness / travel_m)
    found = _touching(replace(squeeze, force_n=touch_n), travel_m)
    assert found.stiffness == pytest.approx(kept * travel_m)


def test_a_force_counts_once_it_was_near_for_long_enough_without_a_break() -> None:
    period_s, near_s, squeeze, report = 0.01, 0.0, closing(3.0, share=0.5), None
    missing = [0.2] * 8 + [-1.0] + [-0.2] * 30
    for number, each in enumerate(missing):
        squeeze, report = _held(replace(squeeze, force_n=3.0 - each), each, 0.02, period_s)
        if report is not None:
            near_s = (number - 8) * period_s
            break
    assert report is not None
    assert (report.end, report.force_n) == (SqueezeEnd.REACHED, 3.2)
    assert squeeze.reached
    assert near_s == pytest.approx(0.1, abs=1.01 * period_s)


def test_a_force_that_is_gone_for_long_enough_is_lost() -> None:
    period_s, near_s, report = 0.01, 0.0, None
    squeeze = replace(closing(3.0, share=0.5), reached=True)
    forces = [0.4] * 8 + [1.0] + [0.4] * 30
    for number, each in enumerate(forces):
        squeeze, report = _held(replace(squeeze, force_n=each), 3.0 - each, 0.02, period_s)
        if report is not None:
            near_s = (number - 8) * period_s
            break
    assert report is not None
    assert report.end is SqueezeEnd.LOST
    assert near_s == pytest.approx(0.1, abs=1.01 * period_s)


def test_at_the_target_a_missing_force_ends_it() -> None:
    squeeze = closing(3.0, share=1.0)
    _, report = _held(replace(squeeze, force_n=1.0), 2.0, 0.02, 0.01)
    assert report is not None
    assert report.end is SqueezeEnd.NOTHING
    for share, missing_n in ((1.0, -2.0), (0.99, 2.0)):
        assert _held(replace(squeeze, share=share), missing_n, 0.02, 0.01)[1] is None


def test_it_needs_a_way_and_a_torque_per_current(config: RobotConfig) -> None:
    start = config.model.inverse(Target(tip_m=(0.030, 0.075, 0.0)), config.rest).actuation
    for way_m, allowed in ((0.0029, False), (0.0031, True)):
        why = why_not(config, start, Target(tip_m=(0.030 + way_m, 0.075, 0.0)))
        assert (why == "") == allowed
        assert allowed or f"{1e3 * way_m:.1f} mm from the target, 3 mm" in why
    armed = RobotState(mode=Mode.HOLD, enabled=True, command=start)
    with pytest.raises(OrderRefusedError, match="nm_per_a"):
        goto(replace(config, squeezes=None), armed, Target(tip_m=(0.05, 0.075, 0.0)), 1.0, 2.0)
    assert math.isfinite(greatest_rate(config, closing()))
