"""Pairs of valves on the machine code of the sketch, at a simulated pump and chambers."""

from __future__ import annotations

import os
import random
from collections.abc import Sequence

import pytest

from tests.firmware.sam3x.board import Sam3x
from tests.firmware.sam3x.build import build_sketch
from tests.firmware.sam3x.host import Host
from tests.firmware.sam3x.plant import Chambers

pytestmark = pytest.mark.process

CASES = int(os.environ.get("CONTID_VALVES", "1"))
PERIOD_MS = 20
#: Six chambers of one board, over the range of lags [s].
LAGS_S = (0.2, 0.3, 0.45, 0.6, 0.8, 1.1)


class Bench:
    """A board with six pairs of valves, armed."""

    def __init__(self, lags_s: Sequence[float], supply_bar: float, delays_s: tuple[float, float]) -> None:
        self.board = Sam3x(build_sketch())
        self.board.jumper()
        self.board.run_ms(25)
        self.board.usb.plug()
        self.board.run_ms(25)
        self.board.usb.open()
        self.host = Host(self.board.ask_usb)
        self.chambers = Chambers(self.board, lags_s, supply_bar, delays_s)
        self.host.configure_valves(len(lags_s))
        self.board.run_ms(40)
        self.host.arm(len(lags_s))

    def to(self, bar: Sequence[float], ms: int) -> list[list[float]]:
        """Command pressures; those of every period, by chamber."""
        trace = []
        for _ in range(ms // PERIOD_MS):
            self.host.demand({i: round(each * 1e5) for i, each in enumerate(bar)})
            self.board.run_ms(PERIOD_MS)
            trace.append(list(self.chambers.pressure_bar))
        return [list(each) for each in zip(*trace, strict=True)]

    def states(self) -> set[str]:
        assert self.host.telemetry is not None
        return {each.state.name for each in self.host.telemetry.channels.values()}


def require_settled(trace: Sequence[float], before: float, goal: float) -> None:
    """At most 5 % beyond, and at rest within 5 %."""
    step = goal - before
    assert max((each - goal) / step for each in trace) <= 0.05
    assert all(abs(each - goal) <= max(0.05 * abs(step), 0.012) for each in trace[-10:])


@pytest.mark.parametrize("seed", range(CASES))
def test_steps_settle_without_overshoot(seed: int) -> None:
    rng = random.Random(seed)
    lags_s = LAGS_S if seed == 0 else [rng.uniform(0.2, 1.1) for _ in LAGS_S]
    delays_s = (rng.uniform(0.001, 0.01), rng.uniform(0.001, 0.01))
    bench = Bench(lags_s, rng.uniform(1.5, 2.5), delays_s)
    before = [0.0] * len(lags_s)
    for _ in range(2):
        goals = [rng.choice([goal for goal in (0.3, 0.5, 0.8, 1.1) if abs(goal - each) >= 0.2]) for each in before]
        traces = bench.to(goals, 2500)
        for trace, each, goal in zip(traces, before, goals, strict=True):
            require_settled(trace, each, goal)
        before = [trace[-1] for trace in traces]
    assert bench.states() == {"ARMED"}


def test_chambers_vent_when_the_host_dies() -> None:
    bench = Bench(LAGS_S, 2.0, (0.006, 0.004))
    bench.to([0.5] * len(LAGS_S), 1000)
    full = list(bench.chambers.pressure_bar)
    passed_ms = 0.0
    while not all(map(bench.chambers.vents, range(len(LAGS_S)))):
        bench.board.run_ms(1)
        passed_ms += 1
        assert passed_ms <= 130
    bench.board.run_ms(100)
    assert all(now < 0.95 * then for now, then in zip(bench.chambers.pressure_bar, full, strict=True))
    print(f"vents {passed_ms + PERIOD_MS:.0f} ms after the last demand")
