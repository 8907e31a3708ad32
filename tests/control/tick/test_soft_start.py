"""A trajectory at speed is entered and left without a jump, on its path, and on its ticks."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.soft_start import ease_ticks, played
from tests.support.fingers import circle, load

EVEN = st.integers(1, 100).map(lambda n: 2 * n)


@given(EVEN, EVEN, st.integers(1, 1000))
def test_the_clock_runs_forward_never_faster_than_written(lead: int, tail: int, middle: int) -> None:
    length = 0.5 * (lead + tail) + middle
    over = round(length + 0.5 * (lead + tail))
    clock = [played(n, length, lead, tail) for n in range(over + 2)]
    paces = [b - a for a, b in pairwise(clock)]
    assert clock[0] == 0.0
    assert clock[-1] == clock[-2] == length
    assert all(-1e-9 <= pace <= 1.0 + 1e-9 for pace in paces)
    # Smooth: the pace changes by no more than its steepest slope, 1.5/N per tick.
    changes = [abs(b - a) for a, b in zip([0.0, *paces], [*paces, 0.0], strict=True)]
    assert max(changes) <= 1.5 / min(lead, tail) + 1e-9


@given(EVEN, EVEN)
def test_between_the_eases_rows_at_ticks_are_met_at_ticks(lead: int, tail: int) -> None:
    length = 1000.0 + lead + tail
    assert [played(n, length, lead, tail) for n in (lead, lead + 7)] == [lead / 2, lead / 2 + 7]


def test_a_start_from_rest_is_played_as_written() -> None:
    loaded = load(1)
    configs = build_robot_configs(loaded, 200.0)
    slow, fast = circle(loaded, period_s=600.0), circle(loaded, period_s=1.0)
    assert ease_ticks(configs, slow, 0.0, ahead=True) == 0
    lead = ease_ticks(configs, fast, 0.0, ahead=True)
    assert lead > 0
    assert lead % 2 == 0
    assert ease_ticks(configs, fast, fast.end_s, ahead=False) == pytest.approx(lead, abs=2)


def test_an_ease_takes_half_of_the_acceleration_and_of_the_jerk() -> None:
    """Peak acceleration 1.5 v/T and peak jerk 6 v/T^2, by the speed of the axes where the circle starts."""
    loaded = load(1)
    (config,) = configs = build_robot_configs(loaded, 200.0)
    fast = circle(loaded, period_s=1.0)
    here, after = (
        config.model.inverse(
            config.frame.target_in_base(fast.targets_at(t_s)[config.name]), config.rest
        ).actuation
        for t_s in (0.0, config.period_s)
    )
    speed = max(abs(b - a) for a, b in zip(here, after, strict=True)) / config.period_s

    def gentle(ticks: int) -> bool:
        time_s = ticks * config.period_s
        return 3.0 * speed / time_s <= config.acceleration[0] and 12.0 * speed / time_s**2 <= config.jerk[0]

    lead = ease_ticks(configs, fast, 0.0, ahead=True)
    assert gentle(lead)
    assert not gentle(lead - 2)
