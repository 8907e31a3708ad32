"""Pressures at the capture of a measurement, and the sides of the hysteresis by the play operator."""

import math

import numpy as np
import pytest

from contid.sense.live.pressure_trace import OLDEST_S, RESTING_S, PressureTrace

PERIOD_S = 0.005
HALF_LOOP = (0.03, 0.01)


def trace_of(reported, commands, ticks, period_s=PERIOD_S):
    """A trace after ``ticks``; a report is what was measured a period before its tick."""
    trace = PressureTrace(HALF_LOOP, period_s)
    for k in range(ticks):
        trace.tick(k * period_s, reported((k - 1) * period_s), commands(k * period_s))
    return trace


def rising(t_s):
    return (0.2 + 0.4 * t_s, 1.0 - 0.7 * t_s)


@pytest.mark.parametrize("period_s", [0.002, 0.005, 0.02, 0.05])
def test_on_a_ramp_the_pressures_are_those_of_the_capture(period_s):
    ticks = max(round(0.5 / period_s), 20)
    trace = trace_of(rising, rising, ticks, period_s)
    # By the rounding of times a report at one end of the average may be left out: half a tick.
    off = 0.51 * period_s * 0.7
    for behind in (8, 11):
        capture_s = (ticks - behind) * period_s
        pose = trace.at(capture_s)
        assert pose is not None
        assert pose.pressures == pytest.approx(rising(capture_s), abs=off)
    newest = trace.at((ticks - 2) * period_s)
    assert newest is not None
    assert newest.pressures == pytest.approx(rising((ticks - 2) * period_s), abs=0.7 * 0.006)


@pytest.mark.parametrize("period_s", [0.002, 0.005, 0.02])
def test_the_time_of_moving_pressures_is_uncertain(period_s):
    trace = trace_of(rising, rising, round(0.5 / period_s), period_s)
    pose = trace.at(0.3)
    assert pose is not None
    if period_s < 0.01:
        assert pose.late == pytest.approx((0.4 * 0.003, -0.7 * 0.003))  # late by up to 3 ms
    else:  # slow ticks have one report in the time that is averaged
        assert pose.late == (0.0, 0.0)


@pytest.mark.parametrize("part", [-0.4, 0.4])
def test_between_slow_ticks_the_nearest_report_counts(part):
    trace = trace_of(rising, rising, 20, 0.05)
    pose = trace.at((12 + part) * 0.05)
    assert pose is not None
    assert pose.pressures == pytest.approx(rising(12 * 0.05))


def test_at_rest_the_time_does_not_matter():
    still = (0.4, 0.5)

    def commands(t_s):
        return still if t_s > 0.2 else rising(t_s)

    moving, resting = (
        trace_of(rising, commands, round((0.2 + rest_s) / PERIOD_S)).at(0.15)
        for rest_s in (0.9 * RESTING_S, 1.1 * RESTING_S)
    )
    assert moving is not None
    assert resting is not None
    assert all(moving.late)
    assert not any(resting.late)


def test_noise_of_the_reports_is_averaged_around_the_capture():
    rng = np.random.default_rng(3)
    off = []
    for _ in range(200):
        trace = trace_of(lambda t_s: tuple(rng.normal(0.5, 0.01, 2)), lambda t_s: (0.5, 0.5), 30)
        pose = trace.at(0.08)
        assert pose is not None
        off.append(pose.pressures[0] - 0.5)
    assert np.std(off) == pytest.approx(0.01 / math.sqrt(5.0), rel=0.2)


def test_invalid_reports_are_left_out_and_without_any_there_is_nothing():
    some = trace_of(lambda t_s: None if round(t_s / PERIOD_S) % 2 else (0.5, 0.7), lambda t_s: (0.5, 0.7), 60)
    pose = some.at(0.2)
    assert pose is not None
    assert pose.pressures == pytest.approx((0.5, 0.7))
    assert trace_of(lambda t_s: None, lambda t_s: (0.5, 0.7), 60).at(0.2) is None
    assert trace_of(rising, lambda t_s: None, 60).at(0.2) is None
    assert PressureTrace(HALF_LOOP, PERIOD_S).at(0.0) is None


def test_a_capture_that_is_too_old_finds_nothing():
    ticks = 400
    trace = trace_of(rising, rising, ticks)
    now_s = (ticks - 1) * PERIOD_S
    assert trace.at(now_s - 0.9 * OLDEST_S) is not None
    assert trace.at(now_s - 1.2 * OLDEST_S) is None


def test_sides_follow_the_commands_as_the_play_operator_does():
    """Between the branches it is how far the command is ahead of a follower with half the loop as play."""
    rng = np.random.default_rng(5)
    trace = PressureTrace(HALF_LOOP, PERIOD_S)
    command, follower = np.full(2, 0.5), np.full(2, 0.5)
    for k in range(300):
        command = command + rng.normal(0.0, 0.006, 2) * bool(k)
        follower = np.clip(follower, command - HALF_LOOP, command + HALF_LOOP)
        for _ in range(4):  # reports need a while; a command that stays moves nothing
            trace.tick(k * 4 * PERIOD_S, tuple(command), tuple(command))
        pose = trace.at(k * 4 * PERIOD_S)
        assert pose is not None
        assert pose.sides == pytest.approx((command - follower) / HALF_LOOP, abs=1e-9)


def test_a_side_is_open_until_its_axis_has_moved_through_the_loop():
    trace = PressureTrace(HALF_LOOP, PERIOD_S)

    def after(*command):
        for _ in range(8):
            trace.tick(0.0, command, command)
        pose = trace.at(-PERIOD_S)
        assert pose is not None
        return pose.side_open

    assert after(0.5, 0.5) == (1.0, 1.0)
    assert after(0.5 + 0.8 * HALF_LOOP[0], 0.5 - 1.01 * HALF_LOOP[1]) == (1.0, 0.0)
    assert after(0.5 - 1.01 * HALF_LOOP[0], 0.5) == (0.0, 0.0)
    assert after(0.5, 0.5) == (0.0, 0.0)
