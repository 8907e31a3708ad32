"""Both ports of the sketch's machine code under load, on the emulated SAM3X8E."""

from __future__ import annotations

import pytest

from contid.hal import AxisOnBus
from contid_drivers.due import frames, messages, wiring
from contid_drivers.due.codes import Type
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from tests.firmware.conftest import REGULATOR
from tests.firmware.exchanges import measure
from tests.firmware.sam3x.board import Sam3x
from tests.firmware.sam3x.build import build_sketch
from tests.firmware.sam3x.host import Host

HELLO = frames.seal(messages.request(Type.HELLO, 1, b""))


def opened(full_speed: bool = False) -> Sam3x:
    board = Sam3x(build_sketch(), full_speed=full_speed)
    board.run_ms(20)
    board.usb.open()
    return board


@pytest.mark.slow
@pytest.mark.parametrize("cycles_per_instruction", [pytest.param(1.0, marks=pytest.mark.campaign), 1.5])
def test_six_moving_motors_lose_no_exchange_on_the_programming_port(cycles_per_instruction: float):
    # The long form: python -m tests.firmware.exchanges
    done = measure(build_sketch(), cycles_per_instruction, 20)
    assert (done.lost, done.overruns, done.resets) == (0, 0, 0)
    assert done.armed
    assert done.furthest > 300, "the motors moved: edges interrupted"
    assert done.worst_ms < 8


@pytest.mark.slow
def test_nine_motors_on_two_boards_take_less_than_a_millisecond():
    boards = [measure(build_sketch(), 1.5, 4, motors, usb=True) for motors in (6, 3)]
    assert all((board.lost, board.resets, board.armed) == (0, 0, True) for board in boards)
    assert sum(board.worst_ms for board in boards) < 1, "one board after the other"


@pytest.mark.parametrize("full_speed", [False, True])
def test_packets_fit_the_link_and_end_the_transfer(full_speed: bool):
    board = opened(full_speed)
    answer = board.ask_usb(HELLO)
    assert frames.unseal(answer[:-1]) is not None
    most = 64 if full_speed else 512
    assert max(board.usb.packets) <= most
    assert board.usb.packets[-1] < most, "a short packet ends the transfer"
    assert board.usb.lost_packets == 0


def test_no_answer_size_ends_with_a_full_packet():
    board = opened(full_speed=True)
    host = Host(board.ask_usb)
    for motors in range(1, 7):
        host.configure(motors)
        host.demand({})
        assert board.usb.packets[-1] < 64
    assert host.lost == 0


@pytest.mark.parametrize("full_speed", [False, True])
def test_a_configuration_above_512_bytes_arrives_in_packets_back_to_back(full_speed: bool):
    board = Sam3x(build_sketch(), full_speed=full_speed)
    board.jumper()
    board.run_ms(20)
    board.usb.open()
    options = {**REGULATOR, "calibration": [[i * 10, i * 0.3] for i in range(8)]}
    axes = [
        AxisOnBus(f"p{i}", DueAxisOptions.model_validate({"channel": f"p{i}", **options}), None)
        for i in range(6)
    ]
    blob = wiring.board_config("b", DueBusOptions(port="x", role=Role.PRESSURE), axes)
    request = frames.seal(messages.request(Type.CONFIGURE, 9, wiring.config_body(blob)))
    assert len(request) > 512
    # Behind the hello before it, so that all banks are full at once.
    board.usb.send(HELLO)
    answer = board.ask_usb(request)
    board.run_ms(5)
    payloads = [frames.unseal(one) for one in bytes(board.usb.received).split(b"\0") if one]
    assert payloads[1] is not None, answer
    assert messages.read_answer(payloads[1]) == (9, messages.Configured(frames.crc16(blob)))
    assert board.usb.lost_packets == 0


@pytest.mark.slow
def test_an_answer_that_stopped_half_way_is_ended_by_a_zero():
    board = opened(full_speed=True)
    board.usb.reads = False
    board.usb.send(HELLO)
    board.run_ms(70)  # two banks are full; the rest is given up after 50 ms
    board.usb.reads = True
    board.usb.send(HELLO)
    board.run_ms(10)
    torn, whole = (one for one in bytes(board.usb.received).split(b"\0") if one)
    assert frames.unseal(torn) is None
    assert frames.unseal(whole) is not None
    assert board.resets == 0, "a host that does not read does not stop the loop"
