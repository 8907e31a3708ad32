"""How soon the outputs of a board are safe after its host, its program or its link stops.

``python -m tests.firmware.dead_man [ELF]`` prints the times, of the machine code on the emulated SAM3X8E.
"""

from __future__ import annotations

import argparse
import enum
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.firmware.elf import read_elf
from tests.firmware.sam3x.board import Sam3x
from tests.firmware.sam3x.build import build_sketch
from tests.firmware.sam3x.cpu import CLOCK_HZ
from tests.firmware.sam3x.host import Host
from tests.firmware.sam3x.plant import Motors, Regulators
from tests.firmware.sam3x.system_control import NEVER

PERIOD_MS = 10
STEP_MS = 0.05
BRANCH_TO_ITSELF = b"\xfe\xe7"


class Failure(enum.StrEnum):
    """What stops."""

    DEMANDS = "the host sends no more"
    READING = "the host sends, and does not read"
    LOOP = "loop() hangs"
    TICK = "the timer of the tick stops"
    CONTROL_TRANSFER = "the link is lost in a control transfer"


TICK_MS = 1.0
#: WDT_MR of the sketch: eight periods of 128 slow clocks of 32 768 Hz.
HARDWARE_MS = 31.25
#: Failures in which only the tick, or only a reset, can act.
STOPS_LOOP = (Failure.LOOP, Failure.CONTROL_TRANSFER)


@dataclass(frozen=True)
class Stop:
    """Times after the last valid demand was sent.

    Attributes:
        failed_ms: of the failure; the demand's exchange lies before it.
        safe_ms: until every motor brakes or is not driven, or the command of every regulator falls.
        resets: by the hardware watchdog.
    """

    failed_ms: float
    safe_ms: float
    resets: int


def start(elf: Path, watchdog_ms: int, pressure: bool) -> tuple[Sam3x, Host, Callable[[], bool]]:
    """A board with six moving motors, or pressure in six chambers; the call is true once all are safe."""
    board = Sam3x(elf)
    if pressure:
        board.jumper()
    board.run_ms(25)
    board.usb.plug()
    board.run_ms(25)
    if not board.usb.opened:  # the stand-in core does not enumerate
        board.usb.open()
    host = Host(board.ask_usb)
    if pressure:
        regulators = Regulators(board)
        host.configure_regulators(watchdog_ms)
        host.arm()
        for _ in range(10):  # the set-point needs 50 ms
            board.run_ms(PERIOD_MS)
            host.demand(dict.fromkeys(range(6), 10_000))
        commanded = [regulators.duty(channel) for channel in range(6)]
        assert all(duty > 0.03 for duty in commanded)
        return board, host, lambda: all(regulators.duty(i) < commanded[i] for i in range(6))
    motors = Motors(board)
    host.configure(watchdog_ms=watchdog_ms)
    host.arm()
    for i in range(5):
        board.run_ms(PERIOD_MS)
        host.demand(dict.fromkeys(range(6), 60 * i))
    assert all(motors.duty(channel) for channel in range(6))
    return board, host, lambda: not any(motors.duty(channel) for channel in range(6))


def measure(elf: Path, failure: Failure, watchdog_ms: int = 100, pressure: bool = False) -> Stop:
    """Let one thing fail in motion."""
    board, host, safe = start(elf, watchdog_ms, pressure)
    goals = dict.fromkeys(range(6), 10_000 if pressure else 600)
    board.run_ms(PERIOD_MS)
    cycles, passed = board.cpu.cycles, 0.0
    if failure is Failure.READING:
        board.usb.reads = False
        board.usb.send(host.demand_frame(goals))  # valid: it echoes the last answer read
    else:
        host.demand(goals)
    failed_ms = (board.cpu.cycles - cycles) * 1000 / CLOCK_HZ
    cpu = board.cpu
    if failure is Failure.LOOP:
        cpu.uc.mem_write(read_elf(elf).symbols["_Z11contid_loopv"] & ~1, BRANCH_TO_ITSELF)
        cpu.uc.ctl_flush_tb()
    elif failure is Failure.TICK:
        board.tc[1].due = NEVER
    elif failure is Failure.CONTROL_TRANSFER:
        board.usb.stall_control()
    assert not safe()
    sent_ms = 0.0
    while not safe():
        board.run_ms(STEP_MS)
        passed += STEP_MS
        assert passed < 2 * watchdog_ms, "it did not stop"
        if failure is Failure.READING and passed - sent_ms >= PERIOD_MS:
            sent_ms = passed
            board.usb.send(host.demand_frame(goals))
    return Stop(failed_ms, failed_ms + passed, board.resets)


def check(elf: Path, failure: Failure, watchdog_ms: int, pressure: bool) -> None:
    done = measure(elf, failure, watchdog_ms, pressure)
    if failure is Failure.TICK or (failure in STOPS_LOOP and watchdog_ms > HARDWARE_MS):
        assert done.resets == 1
        # The board feeds it once per tick, and the failure comes after the exchange.
        assert HARDWARE_MS - TICK_MS < done.safe_ms < HARDWARE_MS + done.failed_ms + TICK_MS
        return
    assert done.resets == 0
    # The board counts ticks from the tick before the demand.
    assert watchdog_ms - TICK_MS <= done.safe_ms <= watchdog_ms + TICK_MS


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("elf", type=Path, nargs="?")
    given = parser.parse_args().elf
    for one in Failure:
        if one is Failure.CONTROL_TRANSFER and given is None:
            continue  # the stand-in core has no control transfers
        for watchdog in (20, 100):
            for regulators in (False, True):
                done = measure(given or build_sketch(), one, watchdog, regulators)
                role = "pressure" if regulators else "motors"
                print(
                    f"{one.value}, watchdog_ms {watchdog}, {role}: "
                    f"{done.safe_ms:.2f} ms after the last valid demand, {done.resets} resets",
                    flush=True,
                )
