"""The ELF file that is flashed, on the emulated SAM3X8E: sketch, Arduino core and libsam as one program.

`CONTID_DUE_ELF` names it, as the IDE, `arduino-cli compile --output-dir` or PlatformIO leaves it.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from pathlib import Path
from unittest.mock import ANY

import pytest

from contid_drivers.due.codes import Type
from tests.firmware.dead_man import Failure, check
from tests.firmware.exchanges import measure
from tests.firmware.sam3x.board import UNIQUE_ID, Sam3x
from tests.firmware.sam3x.host import Host
from tests.firmware.sam3x.set_up import CHECKS, SERIAL_NUMBER, hello, serial_number

GIVEN = os.environ.get("CONTID_DUE_ELF")
pytestmark = [
    pytest.mark.campaign,
    pytest.mark.skipif(GIVEN is None, reason="CONTID_DUE_ELF names no ELF file of the sketch"),
]
ELF = Path(GIVEN or "")


@pytest.fixture(scope="module")
def motors() -> Sam3x:
    board = Sam3x(ELF)
    board.run_ms(25)
    return board


def test_it_boots_once_and_answers_on_both_ports(motors: Sam3x):
    motors.usb.plug()
    motors.run_ms(25)
    assert motors.resets == 0
    assert motors.usb.opened, "the core enumerated"
    answer = hello(motors)
    assert answer.unique_id == UNIQUE_ID.hex()
    assert Host(motors.ask_usb).ask(Type.HELLO) == dataclasses.replace(answer, uptime_ms=ANY)


def test_its_serial_number_on_usb_is_of_the_chip():
    board = Sam3x(ELF)
    board.run_ms(25)
    board.usb.plug()
    board.run_ms(25)
    answer = board.usb.ask_string(SERIAL_NUMBER)
    board.run_ms(5)
    text = serial_number(UNIQUE_ID).encode("utf-16-le")
    assert answer == bytes((len(text) + 2, 3)) + text


@pytest.mark.parametrize("register", CHECKS, ids=lambda one: one.__name__)
def test_set_up(motors: Sam3x, register: Callable[[Sam3x], None]):
    register(motors)


@pytest.mark.parametrize("cycles_per_instruction", [1.0, 1.5])
def test_six_motors_on_the_programming_port(cycles_per_instruction: float):
    done = measure(ELF, cycles_per_instruction, 20)
    assert (done.lost, done.overruns, done.resets, done.armed) == (0, 0, 0, True)


def test_nine_motors_on_two_boards_take_less_than_a_millisecond():
    boards = [measure(ELF, 1.5, 20, motors, usb=True) for motors in (6, 3)]
    assert all((board.lost, board.resets, board.armed) == (0, 0, True) for board in boards)
    assert sum(board.worst_ms for board in boards) < 1, "one board after the other"


@pytest.mark.parametrize("pressure", [False, True], ids=["motors", "pressure"])
@pytest.mark.parametrize("watchdog_ms", [20, 100])
@pytest.mark.parametrize("failure", Failure)
def test_outputs_are_safe_in_time(failure: Failure, watchdog_ms: int, pressure: bool):
    check(ELF, failure, watchdog_ms, pressure)
