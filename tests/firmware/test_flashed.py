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

from contid_drivers.due.codes import BoardState, Type
from tests.firmware.exchanges import measure
from tests.firmware.sam3x.board import UNIQUE_ID, Sam3x
from tests.firmware.sam3x.host import Host
from tests.firmware.sam3x.plant import Motors
from tests.firmware.sam3x.set_up import CHECKS, hello

GIVEN = os.environ.get("CONTID_DUE_ELF")
pytestmark = pytest.mark.skipif(GIVEN is None, reason="CONTID_DUE_ELF names no ELF file of the sketch")
ELF = Path(GIVEN or "")
WATCHDOG_MS = 100


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
    assert Host(motors, usb=True).ask(Type.HELLO) == dataclasses.replace(answer, uptime_ms=ANY)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_set_up(motors: Sam3x, check: Callable[[Sam3x], None]):
    check(motors)


@pytest.mark.parametrize("cycles_per_instruction", [1.0, 1.5])
def test_six_motors_on_the_programming_port(cycles_per_instruction: float):
    done = measure(ELF, cycles_per_instruction, 20)
    assert (done.lost, done.overruns, done.resets, done.armed) == (0, 0, 0, True)


def test_the_dead_man_trips_when_demands_stop():
    board = Sam3x(ELF)
    board.usb.plug()
    board.run_ms(25)
    plant = Motors(board)
    host = Host(board, usb=True)
    host.configure(watchdog_ms=WATCHDOG_MS)
    host.arm()
    for i in range(10):
        board.run_ms(10)
        host.demand(dict.fromkeys(range(6), 60 * i))
    assert all(plant.duty(channel) for channel in range(6))
    board.run_ms(WATCHDOG_MS - 2)
    assert all(plant.duty(channel) for channel in range(6))
    board.run_ms(3)
    # Brake: both inputs high, full PWM.
    assert all(plant.duty(channel) == 0 for channel in range(6))
    host.demand({})
    assert host.telemetry is not None
    assert {report.state for report in host.telemetry.channels.values()} == {BoardState.SAFE}
