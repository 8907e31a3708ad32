"""Pairs of valves on the linked core (Cortex-M3), and on the whole sketch: a simulated pump and chambers."""

from __future__ import annotations

import os
import random
from collections.abc import Sequence
from typing import NamedTuple

import pytest

from contid.hal import AxisOnBus
from contid_devices.due.cortex import build_core
from contid_drivers.due import frames, messages, wiring
from contid_drivers.due.codes import BoardState, Reason, Type
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from tests.firmware.cortex_m import CoreBoard
from tests.firmware.elf import read_elf
from tests.firmware.sam3x.board import Sam3x
from tests.firmware.sam3x.build import build_sketch
from tests.firmware.sam3x.host import Host
from tests.firmware.sam3x.plant import VALVES, Chamber, Chambers

pytestmark = pytest.mark.process

CASES = int(os.environ.get("CONTID_VALVES", "1"))
PERIOD_MS = 20
WATCHDOG_MS = 100
MV_PER_BAR = 3125.0 / 3.0
DRIVES_VALVES = 4


class Report(NamedTuple):
    """A channel in the newest telemetry."""

    state: BoardState
    reason: Reason


class Bench:
    """Six pairs of valves of one board, armed; one millisecond of the world per tick."""

    def __init__(self, chambers: Sequence[Chamber], watchdog_ms: int = WATCHDOG_MS) -> None:
        self.core = CoreBoard(read_elf(build_core("cortex_m3")))
        self.core.start("pressure")
        self.chambers = chambers
        self.sequence = 0
        self.telemetry: messages.Telemetry | None = None
        keys = {f"p{i}": i for i in range(len(chambers))}
        axes = [
            AxisOnBus(name, DueAxisOptions.model_validate({"channel": name, **VALVES}), None) for name in keys
        ]
        options = DueBusOptions(port="x", role=Role.PRESSURE, watchdog_ms=watchdog_ms)
        blob = wiring.board_config("b", options, axes)
        self.crc = frames.crc16(blob)
        self.step(1)
        assert isinstance(self.ask(Type.CONFIGURE, wiring.config_body(blob)), messages.Configured)
        self.step(40)
        self.demand([])
        self.ask(Type.ARM, messages.mask_body(self.crc, range(len(chambers))))

    def step(self, ms: int) -> None:
        """Ticks of the board, and what its lines do to the chambers."""
        outputs = self.core.cpu.image.symbols["m3_outputs"]
        for _ in range(ms):
            self.core.tick()
            for i, chamber in enumerate(self.chambers):
                drive, lines = (
                    self.core.cpu.read(outputs + 8 * i, 1)[0],
                    self.core.cpu.read(outputs + 8 * i + 4, 1)[0],
                )
                chamber.step(lines if drive == DRIVES_VALVES else 0, 1e-3)
                self.core.set_analog(i, min(4095, int(chamber.pressure_bar * MV_PER_BAR / 3300.0 * 4095)))

    def ask(self, kind: Type, body: bytes) -> messages.Answer:
        self.sequence = (self.sequence + 1) & 0xFF
        payload = frames.unseal(self.core.wire(frames.seal(messages.request(kind, self.sequence, body)))[:-1])
        assert payload is not None
        _, answer = messages.read_answer(payload)
        if isinstance(answer, messages.Telemetry):
            self.telemetry = answer
        return answer

    def demand(self, goals_bar: Sequence[float]) -> None:
        echo = self.telemetry.uptime_ms if self.telemetry else 0
        goals = {i: round(each * 1e5) for i, each in enumerate(goals_bar)}
        self.ask(Type.DEMAND, messages.demand(self.crc, echo, goals))

    def to(self, goals_bar: Sequence[float], ms: int) -> list[list[float]]:
        """Command pressures; those of every period, by chamber."""
        trace = []
        for _ in range(ms // PERIOD_MS):
            self.demand(goals_bar)
            self.step(PERIOD_MS)
            trace.append([each.pressure_bar for each in self.chambers])
        return [list(each) for each in zip(*trace, strict=True)]

    def reports(self) -> set[Report]:
        assert self.telemetry is not None
        return {Report(each.state, each.reason) for each in self.telemetry.channels.values()}


def drawn(rng: random.Random) -> list[Chamber]:
    """Chambers with lags of 0.2 to 1.1 s, and valves that open and shut within the stated 10 ms."""
    supply = rng.uniform(1.5, 2.5)
    return [
        Chamber(
            rng.uniform(0.2, 1.1), supply, opens_s=rng.uniform(1e-3, 1e-2), shuts_s=rng.uniform(1e-3, 1e-2),
            swelling=rng.uniform(0.0, 0.5),
        )
        for _ in range(6)
    ]  # fmt: skip


@pytest.mark.parametrize("seed", range(CASES))
def test_steps_settle_without_overshoot(seed: int) -> None:
    rng = random.Random(seed)
    bench = Bench(drawn(rng))
    before = [0.0] * 6
    for _ in range(3):
        goals = [
            rng.choice([goal for goal in (0.2, 0.5, 0.8, 1.1) if abs(goal - each) >= 0.2]) for each in before
        ]
        traces = bench.to(goals, 3000)
        for chamber, trace, each, goal in zip(bench.chambers, traces, before, goals, strict=True):
            step = goal - each
            assert max((value - goal) / step for value in trace) <= 0.05, (chamber, each, goal)
            # 0.01 bar around the command there is no pulse.
            assert all(abs(value - goal) <= max(0.05 * abs(step), 0.015) for value in trace[-25:]), chamber
        before = [trace[-1] for trace in traces]
    assert bench.reports() == {Report(BoardState.ARMED, Reason.NONE)}


def test_a_chamber_vents_at_the_command_of_no_pressure_and_at_rest() -> None:
    bench = Bench([Chamber(0.3, 2.0)])
    assert max(bench.to([0.8], 2000)[0]) > 0.75
    bench.to([0.0], 1500)
    assert bench.chambers[0].pressure_bar < 0.02
    assert bench.chambers[0].powered == (False, False)


def test_chambers_vent_within_the_watchdog_when_the_host_dies() -> None:
    bench = Bench([Chamber(lag_s, 2.0) for lag_s in (0.2, 0.3, 0.45, 0.6, 0.8, 1.1)])
    bench.to([0.8] * 6, 1600)
    bench.demand([0.8] * 6)
    for _ in range(WATCHDOG_MS + 1):
        bench.step(1)
        if all(each.powered == (False, False) for each in bench.chambers):
            break
    else:
        pytest.fail("an outlet is shut after the watchdog")
    full = [each.pressure_bar for each in bench.chambers]
    bench.step(1500)
    assert all(each.pressure_bar < 0.35 * before for each, before in zip(bench.chambers, full, strict=True))
    bench.demand([])
    assert bench.reports() == {Report(BoardState.SAFE, Reason.WATCHDOG)}


def test_a_leak_that_the_pump_does_not_cover_is_a_fault() -> None:
    bench = Bench([Chamber(0.5, 2.0)])
    bench.to([0.8], 2000)
    bench.chambers[0].supply_bar = 0.1
    bench.chambers[0].leak_per_s = 1.0
    bench.to([0.8], 8000)
    assert bench.reports() == {Report(BoardState.SAFE, Reason.LEAK)}


@pytest.mark.campaign
def test_the_lines_of_the_whole_sketch_drive_the_valves_and_vent() -> None:
    board = Sam3x(build_sketch())
    board.jumper()
    board.run_ms(25)
    board.usb.plug()
    board.run_ms(25)
    board.usb.open()
    host = Host(board.ask_usb)
    chambers = Chambers(board, [Chamber(0.2, 2.0) for _ in range(6)])
    assert all(chambers.lines(i) == 0 for i in range(6))  # pull-downs: no power
    host.configure_valves(6)
    board.run_ms(20)
    host.arm()
    for _ in range(5):
        host.demand(dict.fromkeys(range(6), 40_000))
        board.run_ms(PERIOD_MS)
    assert all(0.05 < each.pressure_bar < 0.42 for each in chambers.chambers)
    host.demand(dict.fromkeys(range(6), 40_000))
    passed_ms = 0.0
    while any(chambers.lines(i) for i in range(6)):
        board.run_ms(5)
        passed_ms += 5
        assert passed_ms <= WATCHDOG_MS
