"""How much of the Due's processor six motors take: ``python -m tests.firmware.test_budget`` prints it.

Instructions are counted on an emulated Cortex-M3. Cycles are estimated from them: 1.5 per instruction (single
cycle ones, taken branches, multiplications and the flash's wait states), and 24 to enter and leave an
interrupt. Budget: 35 % of 84 MHz for 6100 edges/s on each of six motors and a control tick of 1 kHz.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import pytest

from contid.hal import AxisOnBus
from contid_devices.due.cortex import (
    ARDUINO_FLASH,
    ARDUINO_RAM,
    FLASH_BYTES,
    RAM_BYTES,
    build_core,
    memory_use,
)
from contid_drivers.due import frames, messages, wiring
from contid_drivers.due.codes import BoardState, Type
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from tests.firmware.cortex_m import CoreBoard
from tests.firmware.elf import read_elf

pytestmark = pytest.mark.process

CLOCK_HZ = 84_000_000
BUDGET = 0.35
MOTORS = 6
EDGES_PER_S = 6100
CYCLES_PER_INSTRUCTION = 1.5
CYCLES_PER_INTERRUPT = 24
#: Instructions of the board layer around the core in one tick: reading counters and ADC, writing PWM.
BOARD_LAYER = 400


@dataclass(frozen=True)
class Load:
    """Instructions of one call, and the share of the processor."""

    tick: int
    tick_mean: float
    edge: int

    @property
    def tick_share(self) -> float:
        cycles = (self.tick + BOARD_LAYER) * CYCLES_PER_INSTRUCTION + CYCLES_PER_INTERRUPT
        return 1000 * cycles / CLOCK_HZ

    @property
    def edge_share(self) -> float:
        cycles = self.edge * CYCLES_PER_INSTRUCTION + CYCLES_PER_INTERRUPT
        return MOTORS * EDGES_PER_S * cycles / CLOCK_HZ


def measure() -> Load:
    """Six armed motors on streamed demands at 10 cm/s; the longest of 300 ticks, and of 64 edges."""
    board = CoreBoard(read_elf(build_core()))
    board.start("motor")
    axes = [
        AxisOnBus(f"m{i}", DueAxisOptions.model_validate({"channel": f"m{i}"}), (-10.0, 60.0))
        for i in range(MOTORS)
    ]
    blob = wiring.board_config("b", DueBusOptions(port="x", role=Role.MOTOR), axes)
    crc = frames.crc16(blob)

    def ask(kind: Type, body: bytes) -> messages.Answer:
        payload = frames.unseal(board.wire(frames.seal(messages.request(kind, 1, body)))[:-1])
        assert payload is not None
        return messages.read_answer(payload)[1]

    board.tick()
    assert isinstance(ask(Type.CONFIGURE, wiring.config_body(blob)), messages.Configured)
    answer = ask(Type.ARM, messages.mask_body(crc, range(MOTORS)))
    ticks = []
    for now in range(300):
        assert isinstance(answer, messages.Telemetry)
        assert all(report.state is BoardState.ARMED for report in answer.channels.values())
        if now % 5 == 0:
            # The last third is a step to a far goal: the longest way through the set-point's root.
            goal = EDGES_PER_S * now // 1000 if now < 200 else 39526
            answer = ask(
                Type.DEMAND, messages.demand(crc, answer.uptime_ms, dict.fromkeys(range(MOTORS), goal))
            )
        for motor in range(MOTORS):
            board.set_count(motor, shaft(now))
        ticks.append(board.tick(count=True))
    edges = []
    for i in range(64):
        gray = (i % 4) ^ ((i % 4) >> 1)
        board.cpu.call("m3_edge", gray << 1, 1 << 1, count=True)
        edges.append(board.cpu.instructions)
    assert struct.pack("<i", board.cpu.call("m3_count") & 0x7FFFFFFF)[0] in (63, 64)  # they were counted
    return Load(max(ticks), sum(ticks) / len(ticks), max(edges))


def shaft(now_ms: int) -> int:
    """Where a motor is that starts at the acceleration limit and then turns at the full edge rate."""
    acceleration = 2300.0 / 360.0 * 4776.0
    rising = min(now_ms / 1000.0, EDGES_PER_S / acceleration)
    return int(acceleration * rising**2 / 2 + EDGES_PER_S * (now_ms / 1000.0 - rising))


def report() -> str:
    load = measure()
    flash, ram = memory_use(build_core())
    share = load.tick_share + load.edge_share
    return (
        f"control tick, {MOTORS} motors: {load.tick} instructions at most, {load.tick_mean:.0f} on average "
        f"-> {load.tick_share:.1%} at 1 kHz\n"
        f"edge interrupt: {load.edge} instructions -> {load.edge_share:.1%} at {MOTORS} x {EDGES_PER_S}/s\n"
        f"together {share:.1%} of {CLOCK_HZ / 1e6:.0f} MHz (estimated cycles), budget {BUDGET:.0%}\n"
        f"core: {flash} B flash, {ram} B RAM; with the Arduino core about "
        f"{flash + ARDUINO_FLASH} of {FLASH_BYTES} B and {ram + ARDUINO_RAM} of {RAM_BYTES} B"
    )


def test_six_motors_fit_the_budget():
    load = measure()
    assert load.tick_share + load.edge_share < BUDGET
    # A tick must end long before the next, and an interrupt before the next edge of the same motor (164 us).
    assert load.tick_share < 0.25
    assert load.edge * CYCLES_PER_INSTRUCTION + CYCLES_PER_INTERRUPT < 164e-6 * CLOCK_HZ / 10


def test_flash_and_ram_are_bounded():
    flash, ram = memory_use(build_core())
    assert 4_000 < flash < 48 * 1024
    assert 1_000 < ram < 16 * 1024


if __name__ == "__main__":
    print(report())
