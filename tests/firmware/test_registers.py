"""The sketch's machine code on an emulated SAM3X8E: the registers after its set-up, and its first answers.

Built with PyPI's ziglang and a stand-in for the Arduino core; `test_flashed.py` runs the ELF that is flashed.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.firmware.elf import read_elf
from tests.firmware.sam3x.board import UNIQUE_ID, Sam3x
from tests.firmware.sam3x.build import build_sketch
from tests.firmware.sam3x.set_up import CHECKS, hello, serial_number


@pytest.fixture(scope="module")
def motors() -> Sam3x:
    board = Sam3x(build_sketch())
    board.run_ms(20)
    assert board.resets == 0
    return board


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_set_up(motors: Sam3x, check: Callable[[Sam3x], None]):
    check(motors)


def test_hello_has_the_chip_and_the_start(motors: Sam3x):
    answer = hello(motors)
    assert answer.unique_id == UNIQUE_ID.hex()
    assert (answer.boot, answer.boot_id, answer.cause.name) == (1, 0x5EED_0000, "POWER_UP")


def test_the_usb_serial_number_is_of_the_chip(motors: Sam3x):
    assert serial_number(b"a") == "AF63DC4C8601EC8C"  # the published test vector
    symbol = read_elf(build_sketch()).symbols["usb_serial_number"]
    assert motors.cpu.uc.mem_read(symbol, 17) == serial_number(UNIQUE_ID).encode() + b"\0"


def test_a_jumper_makes_it_a_pressure_board():
    board = Sam3x(build_sketch())
    board.jumper()
    board.run_ms(20)
    assert hello(board).role == 1
    assert board.tc[0].running is False
    assert board.pio["C"].read(0x18) & 1 << 6 == 0, "no direction outputs"


def test_a_loop_that_hangs_resets_the_board():
    elf = build_sketch()
    board = Sam3x(elf)
    board.run_ms(20)
    board.cpu.uc.mem_write(read_elf(elf).symbols["_Z11contid_loopv"] & ~1, b"\xfe\xe7")  # branch to itself
    board.cpu.uc.ctl_flush_tb()
    board.run_ms(board.watchdog.period_s * 1000 + 2)
    assert board.resets == 1


@pytest.mark.slow
def test_a_board_whose_tick_stops_resets_and_starts_again():
    board = Sam3x(build_sketch())
    board.run_ms(20)
    board.tc[1].due = 1 << 62  # the timer's clock fails
    board.run_ms(40)
    assert board.resets == 1
    board.run_ms(20)
    answer = hello(board)
    assert (answer.boot, answer.boot_id, answer.cause.name) == (2, 0x5EED_0001, "WATCHDOG")
