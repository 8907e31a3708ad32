"""A board whose waiting turns are skipped is, bit for bit, one on which they run."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence

import pytest
from unicorn import arm_const

from tests.firmware.sam3x.board import Sam3x
from tests.firmware.sam3x.build import build_sketch
from tests.firmware.sam3x.cpu import Cpu
from tests.firmware.sam3x.host import Host
from tests.firmware.sam3x.plant import Motors, Regulators
from tests.firmware.sam3x.turns import Turn

REGISTERS = [getattr(arm_const, f"UC_ARM_REG_R{number}") for number in range(13)] + [
    arm_const.UC_ARM_REG_SP, arm_const.UC_ARM_REG_LR, arm_const.UC_ARM_REG_PC, arm_const.UC_ARM_REG_XPSR,
]  # fmt: skip


def moves_motors_over_usb(board: Sam3x) -> None:
    board.run_ms(10)
    board.usb.open()
    Motors(board)
    host = Host(board.ask_usb)
    host.configure()
    host.arm()
    for goal in (100, 200):
        host.demand(dict.fromkeys(range(6), goal))
        board.run_ms(4)


def fills_chambers_over_the_programming_port(board: Sam3x) -> None:
    board.jumper()
    board.run_ms(10)
    Regulators(board)
    host = Host(board.ask_uart)
    host.configure_regulators()
    host.arm()
    host.demand(dict.fromkeys(range(6), 10_000))


def is_left_alone_in_long_quanta(board: Sam3x) -> None:
    board.cpu.quantum = 512
    board.run_ms(10)
    board.usb.open()
    board.run_ms(7.3)
    board.cpu.uc.mem_write(0x2007_0100, b"\x01")  # memory, from outside
    board.run_ms(0.1)


@pytest.fixture
def trace(monkeypatch: pytest.MonkeyPatch) -> list[Sequence[int]]:
    """Every write to a peripheral, every exception and every stop, with its cycle."""
    seen: list[Sequence[int]] = []
    write, enter, run = Cpu._write, Cpu._enter_waiting, Cpu.run

    def see_write(cpu: Cpu, user: object, offset: int, size: int, value: int, base: int) -> None:
        if cpu.turns is None or cpu.turns.rehearsal is None:
            seen.append((cpu.cycles, base + offset, size, value))
        write(cpu, user, offset, size, value, base)

    def see_enter(cpu: Cpu) -> bool:
        seen.append((cpu.cycles, cpu._pc))
        return enter(cpu)

    def see_run(cpu: Cpu, until: int) -> None:
        run(cpu, until)
        seen.append((cpu.cycles, *map(cpu.uc.reg_read, REGISTERS)))

    monkeypatch.setattr(Cpu, "_write", see_write)
    monkeypatch.setattr(Cpu, "_enter_waiting", see_enter)
    monkeypatch.setattr(Cpu, "run", see_run)
    return seen


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.parametrize(
    ("history", "cycles_per_instruction", "least"),
    [
        (moves_motors_over_usb, 1.5, 0.2),
        (fills_chambers_over_the_programming_port, 1.3, 0.2),
        (is_left_alone_in_long_quanta, 1.0, 0.6),
    ],
)
def test_what_is_skipped_changes_nothing(
    history: Callable[[Sam3x], None], cycles_per_instruction: float, least: float, trace: list[Sequence[int]]
):
    ends, traces = [], []
    for skips in (False, True):
        trace.clear()
        board = Sam3x(build_sketch(), cycles_per_instruction, skips=skips)
        history(board)
        traces.append(list(trace))
        ends.append((board.cpu.cycles, bytes(board.cpu.uc.mem_read(0x2007_0000, 96 * 1024))))
    assert len(traces[0]) > 100
    assert traces[0] == traces[1]
    assert ends[0] == ends[1]
    assert board.cpu.turns is not None
    assert board.cpu.turns.skipped > least * board.cpu.cycles


#: ``ldr r1, =MEMORY; again: ldr r0, [r1]; adds r0, #1; str r0, [r1]; movs r0, #0; b again``
COUNTS = bytes.fromhex("0249 0868 0130 0860 0020 fae7 00000720")
#: ``ldr r1, =SYST_CVR; ldr r2, =20000; again: ldr r0, [r1]; cmp r0, r2; mov r0, r2; nop; bhi again; b .``
AWAITS_A_TIME = bytes.fromhex("0349 044a 0868 9042 1046 00bf fad8 fee7 18e000e0 204e0000")


def run_program(program: bytes, skips: bool) -> Cpu:
    """A program of its own up to cycle 30 000, with 42 000 cycles to the next tick of SysTick."""
    cpu = Cpu(skips=skips)
    cpu.uc.mem_write(0x0008_0000, struct.pack("<II", 0x2007_8000, 0x0008_0011) + bytes(8) + program)
    cpu.boot()
    cpu.system.write(0x14, 41_999)
    cpu.system.write(0x10, 5)
    cpu.run(30_000)
    return cpu


def test_a_loop_that_only_changes_memory_does_not_wait():
    ran, skipped = (run_program(COUNTS, skips) for skips in (False, True))
    counts = [struct.unpack("<I", cpu.uc.mem_read(0x2007_0000, 4)) for cpu in (ran, skipped)]
    assert counts[0][0] == 20_000 // 5
    assert counts[0] == counts[1]


def test_a_loop_that_awaits_a_time_sees_it():
    ran, skipped = (run_program(AWAITS_A_TIME, skips) for skips in (False, True))
    assert ran.uc.reg_read(arm_const.UC_ARM_REG_PC) & ~1 == 0x0008_001E
    assert skipped.uc.reg_read(arm_const.UC_ARM_REG_PC) & ~1 == 0x0008_001E


def test_a_turn_from_another_instruction_stops_at_the_same_ones():
    turn = Turn(7, (0, 1, 3, 3, 4, 6, 6), (11, 22))
    moved = turn.begun_at(3, reads=1)
    assert moved.stops == [0, 1, 3, 3, 4, 5, 0]
    assert moved.reads == (22, 11)
    assert (3 + moved.after([2, 4])) % 7 == turn.after([3, 2, 4])
