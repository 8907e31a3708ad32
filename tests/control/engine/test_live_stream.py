"""Live streams in virtual time: smooth, in time, within every limit, and at rest on the last row."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest

from contid.control.engine.events.run import StreamDelayed
from contid.control.engine.messages import EndOfRows
from contid.control.engine.sources import Live
from tests.control.engine.streamed import CIRCLE_M, CIRCLE_S, Run, circle, middle, rows_of


@pytest.mark.parametrize(
    ("rate_hz", "jitter_s", "lost", "most", "error_m"),
    [
        (10.0, 0.0, 0.0, 2.0, 1e-4),
        pytest.param(20.0, 0.005, 0.0, 2.0, 1e-4, marks=pytest.mark.campaign),
        pytest.param(50.0, 0.0, 0.0, 1.3, 3e-5, marks=pytest.mark.campaign),
        (50.0, 0.005, 0.01, 3.0, 1e-4),
        pytest.param(60.0, 0.0, 0.0, 1.3, 3e-5, marks=pytest.mark.campaign),
        (100.0, 0.005, 0.0, 1.3, 3e-5),
        pytest.param(200.0, 0.002, 0.0, 1.3, 3e-5, marks=pytest.mark.campaign),
        (500.0, 0.005, 0.0, 1.3, 3e-5),
    ],
)
def test_a_smooth_path_stays_smooth(
    rate_hz: float, jitter_s: float, lost: float, most: float, error_m: float
) -> None:
    """Against the path itself: acceleration, jerk, no limit, the delay, the error behind that delay."""
    run = Run("finger")
    at = circle(run, CIRCLE_M)
    run.at_rest_on(at(0.0))
    followed = run.follow(list(rows_of(at, rate_hz, jitter_s, lost)), 5.5)
    on = followed.time_s > 3.0
    tips, times_s, h = followed.tip_m[on], followed.time_s[on], run.config.period_s
    bar_s = 2.0 / rate_hz + 2.0 * jitter_s + 2.0 * h
    errors = [
        (float(np.sqrt(((np.array([at(t - delay) for t in times_s]) - tips) ** 2).sum(1).mean())), delay)
        for delay in np.arange(0.0, bar_s + 0.02, 5e-4)
    ]
    error, delay_s = min(errors)
    assert error <= error_m
    assert delay_s <= bar_s
    acceleration = np.diff(tips, 2, axis=0) / h**2
    ideal = CIRCLE_M * (2.0 * math.pi / CIRCLE_S) ** 2
    assert float(np.sqrt((acceleration**2).sum(1).mean())) <= most * ideal
    assert run.rates(followed)[2] <= 1.0 + 1e-6
    assert not followed.limited[on].any()


@pytest.mark.parametrize(
    ("rate_hz", "held_s"),
    [
        (20.0, 0.045),
        (200.0, 0.03),
        *(
            pytest.param(*each, marks=pytest.mark.campaign)
            for each in product((20.0, 100.0, 200.0), (0.012, 0.03, 0.045))
            if each not in ((20.0, 0.045), (200.0, 0.03))
        ),
    ],
)
def test_a_writer_that_stood_still_is_not_felt(rate_hz: float, held_s: float) -> None:
    """Rows that a busy host held back come at once: no limit, little jerk, on the path again."""
    run = Run("finger")
    at = circle(run, CIRCLE_M)
    run.at_rest_on(at(0.0))
    rows = [(2.0 + held_s if 2.0 <= t < 2.0 + held_s else t, tip) for t, tip in rows_of(at, rate_hz, 0.0)]
    followed = run.follow(rows, 3.5)
    on, h = followed.time_s > 1.5, run.config.period_s
    assert not followed.limited[on].any()
    assert np.abs(np.diff(followed.axes[on], 3, axis=0)).max() / h**3 < 0.1 * max(run.config.jerk)
    x, y, _ = middle(run)
    radii = np.hypot(followed.tip_m[on, 0] - x + CIRCLE_M, followed.tip_m[on, 1] - y)
    assert np.abs(radii - CIRCLE_M).max() < 1e-4


@pytest.mark.parametrize("pace", [2.0, pytest.param(3.0, marks=pytest.mark.campaign)])
def test_a_host_that_was_slow_for_45_ms_is_no_slower_stream(pace: float) -> None:
    """Its rows come at an even, slower pace, and then at once: three gaps that agree were another period."""
    run = Run("finger")
    at = circle(run, CIRCLE_M)
    run.at_rest_on(at(0.0))
    rows = [
        (max(t, min(2.0 + pace * (t - 2.0), 2.045)) if t >= 2.0 else t, tip)
        for t, tip in rows_of(at, 200.0, 0.0)
    ]
    followed = run.follow(rows, 3.5)
    on = followed.time_s > 1.5
    assert not followed.limited[on].any()
    x, y, _ = middle(run)
    radii = np.hypot(followed.tip_m[on, 0] - x + CIRCLE_M, followed.tip_m[on, 1] - y)
    assert np.abs(radii - CIRCLE_M).max() < 1e-4


@pytest.mark.parametrize(
    ("rate_hz", "jitter_s"),
    [
        (20.0, 0.01),
        (50.0, 0.02),
        (200.0, 0.01),
        *(pytest.param(rate_hz, 0.01, marks=pytest.mark.campaign) for rate_hz in (50.0, 100.0)),
    ],
)
@pytest.mark.parametrize("seed", [1, pytest.param(4, marks=pytest.mark.campaign)])
def test_a_stream_that_ends_amid_a_motion_goes_no_farther_than_its_stop(
    rate_hz: float, jitter_s: float, seed: int
) -> None:
    """10 mm/s for 50 ms and the way to rest from there: below a millimetre; rows come late and together."""
    run, random, before_s = Run("finger"), np.random.default_rng(seed), 0.0
    x, y, z = middle(run)
    run.at_rest_on((x, y, z))
    rows = []
    for k in range(int(0.6 * rate_hz)):
        before_s = max(before_s, 0.0031 + k / rate_hz + float(random.uniform(0.0, jitter_s)))
        rows.append((before_s, (x + 0.01 * k / rate_hz, y, z)))
    followed = run.follow(rows, 2.0)
    assert followed.tip_m[:, 0].max() < rows[-1][1][0] + 1e-3
    assert followed.tip_m[-1, 0] == pytest.approx(rows[-1][1][0], abs=1e-6)


@pytest.mark.parametrize("robot", ["finger", "cbha", pytest.param("trirack", marks=pytest.mark.campaign)])
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.campaign) for k in range(1, 6))])
def test_limits_hold_whatever_the_rows_do(robot: str, seed: int) -> None:
    """Rows that jump, stop, restart, change their rate; velocity, acceleration and jerk of the file hold."""
    run, random = Run(robot), np.random.default_rng(seed)
    model = run.config.model
    low, high = np.array(model.lower), np.array(model.upper)
    run.at_rest_on(middle(run))
    rows, now_s = [], 0.0
    while now_s < 5.0:
        gap_s = float(random.choice([0.002, 0.01, 0.02, 0.1, 0.6]))
        spread = float(random.choice([0.0, 0.01, 0.2]))
        for _ in range(int(random.integers(1, 30))):
            share = 0.4 + spread * random.uniform(-1.0, 1.0, len(low))
            axes = tuple((low + share * (high - low)).tolist())
            rows.append((now_s, model.forward(axes).tip_m))
            now_s += gap_s
    followed = run.follow(rows, 5.0)
    assert max(run.rates(followed)) <= 1.0 + 1e-6


@pytest.mark.parametrize("rate_hz", [20.0, 100.0])
def test_it_rests_on_the_last_row_of_a_stream_that_stops(rate_hz: float) -> None:
    run = Run("finger")
    at = circle(run, CIRCLE_M)
    run.at_rest_on(at(0.0))
    rows = list(rows_of(at, rate_hz, 0.0, seconds=1.0))
    followed = run.follow(rows, 2.5)
    assert math.dist(followed.tip_m[-1], rows[-1][1]) < 1e-9
    assert (followed.axes[-1] == followed.axes[-2]).all()
    beyond = np.linalg.norm(
        followed.tip_m - np.array([at(t) for t in np.minimum(followed.time_s, 1.0)]), axis=1
    )
    assert beyond[followed.time_s > 1.0].max() < 3e-3
    assert run.rates(followed)[2] <= 1.0 + 1e-6


def test_a_jump_from_rest_is_a_straight_line() -> None:
    run = Run("finger")
    start = middle(run)
    end = (start[0] + 0.01, start[1] + 0.006, 0.0)
    run.at_rest_on(start)
    followed = run.follow([(0.0, end)], 2.0)
    along = np.subtract(end, start) / math.dist(start, end)
    way = followed.tip_m - np.array(start)
    across = way - np.outer(way @ along, along)
    assert np.linalg.norm(across, axis=1).max() < 1e-6
    assert math.dist(followed.tip_m[-1], end) < 1e-9
    assert run.rates(followed)[2] <= 1.0 + 1e-6
    assert not followed.limited.any()


def test_the_delay_is_stated() -> None:
    run = Run("finger")
    at = circle(run, CIRCLE_M)
    run.at_rest_on(at(0.0))
    run.follow(list(rows_of(at, 50.0, 0.0, seconds=2.0)), 2.0)
    source = run.engine.selector.source
    assert isinstance(source, Live)
    assert source.delay_s == pytest.approx(0.04, abs=0.006)
    stated = [event.delay_ms for event in run.events if isinstance(event, StreamDelayed)]
    assert stated[-1] == pytest.approx(1e3 * source.delay_s, rel=0.1)


def test_rows_that_waited_for_the_run_do_not_confuse_the_clock() -> None:
    """A producer that began before the run: its first rows arrive at once."""
    run = Run("finger")
    at = circle(run, CIRCLE_M)
    run.at_rest_on(at(0.0))
    rows = [(max(time_s - 0.5, 0.0), tip) for time_s, tip in rows_of(at, 50.0, 0.0)]
    followed = run.follow(rows, 4.0)
    assert not followed.limited[followed.time_s > 2.0].any()


def test_a_stream_that_ended_is_over_on_its_last_row() -> None:
    run = Run("finger")
    at = circle(run, CIRCLE_M)
    run.at_rest_on(at(0.0))
    run.follow(list(rows_of(at, 50.0, 0.0, seconds=1.0)), 1.0)
    run.engine.obey(EndOfRows(), run.process.tick)
    while not run.engine.selector.ended:
        run.tick()
    state = run.engine.robots.states[0]
    assert math.dist(run.config.model.forward(state.command).tip_m, at(0.98)) < 1e-9
