"""Clocks: simulated networks with known truth."""

import math
import random

import pytest

from contid_mocap.clock import DRIFT, EchoClock, LeastLatency


def test_the_offset_is_within_its_bound_whatever_the_delays():
    """Delays differ by direction and have tails; the server's clock is off, and drifts by 50 ppm."""
    for seed in range(20):
        rng = random.Random(seed)
        clock, offset_s = EchoClock(), rng.uniform(-1e5, 1e5)
        for k in range(200):
            sent_s = 100.0 + 0.5 * k
            there_s = sent_s + 1e-4 + rng.expovariate(1e3)
            back_s = there_s + 2e-5 + rng.expovariate(500)
            clock.echoed(sent_s, back_s, (there_s + offset_s) * (1 + 5e-5))
            now_s = back_s + 0.3
            off_s = clock.local_s((now_s + offset_s) * (1 + 5e-5)) - now_s
            assert abs(off_s) <= clock.bound_s(now_s) + 1e-6
            if k > 20:
                assert clock.bound_s(now_s) < 2e-3


def test_a_server_that_starts_again_is_noticed_with_the_next_echo():
    clock = EchoClock()
    assert math.isnan(clock.local_s(1.0))
    clock.echoed(10.0, 10.0001, 500.0)
    clock.echoed(20.0, 20.002, 510.0)
    assert clock.local_s(510.0) == pytest.approx(20.0, abs=1e-3)
    clock.echoed(30.0, 30.01, 3.0)
    assert clock.local_s(3.0) == pytest.approx(30.005, abs=6e-3)


def test_an_echo_that_took_long_does_not_count():
    clock = EchoClock()
    clock.echoed(10.0, 10.5, 1.0)
    clock.echoed(11.0, 10.9, 1.0)
    assert clock.fix is None
    assert clock.bound_s(12.0) == math.inf
    assert DRIFT < 1e-3


def test_the_least_latency_of_a_window_counts_as_none():
    rng = random.Random(1)
    least = LeastLatency(2.0)
    for k in range(2000):
        sent_s = 0.01 * k
        delay_s = 1e-3 + rng.expovariate(500)
        local_s = least.local_s(sent_s, 70.0 + sent_s + delay_s)
        assert local_s <= 70.0 + sent_s + delay_s
        if k > 200:
            assert local_s - (70.0 + sent_s) == pytest.approx(1e-3, abs=0.3e-3)
    least.clear()
    assert least.local_s(0.0, 5.0) == 5.0
