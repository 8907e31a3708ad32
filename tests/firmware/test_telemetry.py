"""Who commands a board, and what it counts: in virtual time, and with the registers of the chip."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from contid_drivers.due import frames, messages
from contid_drivers.due.codes import BoardState, Reason, Refusal, RestCode, Type
from contid_drivers.due.messages import Answer, Hello, Refused, Telemetry
from tests.firmware.conftest import VirtualBoard
from tests.firmware.sam3x.board import Sam3x
from tests.firmware.sam3x.build import build_sketch
from tests.firmware.sam3x.host import Host

pytestmark = pytest.mark.process

Make = Callable[[str], VirtualBoard]


def programming(board: VirtualBoard, kind: Type, body: bytes = b"") -> Answer:
    """A request on the other port."""
    wire = board.command(f"rx2 {frames.seal(messages.request(kind, 5, body)).hex()}")
    payload = frames.unseal(bytes.fromhex(wire)[:-1])
    assert payload is not None
    return messages.read_answer(payload)[1]


@pytest.fixture
def motors(board: Make) -> VirtualBoard:
    made = board("motor")
    made.configure({"m0": {}, "m1": {}})
    made.arm(0, 1)
    return made


def test_one_port_commands_while_a_channel_is_armed(motors: VirtualBoard) -> None:
    empty = messages.demand(motors.crc, 0, {})
    one = messages.mask_body(motors.crc, [0])
    refused = Refused(Type.DEMAND, Refusal.OTHER_PORT, 0)
    assert programming(motors, Type.DEMAND, empty) == refused
    for kind in (Type.ARM, Type.CLEAR, Type.HOME):
        assert programming(motors, kind, one) == Refused(kind, Refusal.OTHER_PORT, 0)
    assert isinstance(programming(motors, Type.HELLO), Hello)
    motors.step(20)
    assert motors.demand({0: 10}).channels[0].state is BoardState.ARMED
    stopped = programming(motors, Type.STOP, messages.stop([0, 1], RestCode.RELAX))
    assert isinstance(stopped, Telemetry)
    assert stopped.channels[0].state is BoardState.STOPPED
    # Nothing is armed: the other port takes over, and keeps the first one out.
    assert isinstance(programming(motors, Type.ARM, one), Telemetry)
    assert motors.ask(Type.DEMAND, empty) == Refused(Type.DEMAND, Refusal.OTHER_PORT, 1)


def test_the_other_port_takes_over_once_the_watchdog_has_stopped_everything(motors: VirtualBoard) -> None:
    empty = messages.demand(motors.crc, 0, {})
    motors.step(99)
    assert isinstance(programming(motors, Type.DEMAND, empty), Refused)
    motors.step(2)
    taken = programming(motors, Type.DEMAND, empty)
    assert isinstance(taken, Telemetry)
    assert taken.channels[0].reason is Reason.WATCHDOG


def test_the_watchdog_counts_its_stops_and_the_longest_gap(motors: VirtualBoard) -> None:
    for gap_ms in (10, 37, 20):
        motors.step(gap_ms)
        telemetry = motors.demand({0: 0})
    assert (telemetry.trips, telemetry.longest_ms) == (0, 37)
    motors.step(150)
    telemetry = motors.demand({})
    assert (telemetry.trips, telemetry.longest_ms) == (2, 100)
    motors.step(500)
    assert motors.demand({}).longest_ms == 100, "gaps count while a channel is armed only"


def test_missed_edges_are_in_telemetry_before_they_are_a_fault(motors: VirtualBoard) -> None:
    motors.command("set 1 missed 5")
    motors.step(5)
    telemetry = motors.demand({})
    assert [telemetry.channels[i].missed_edges for i in (0, 1)] == [0, 5]
    assert telemetry.channels[1].state is BoardState.ARMED
    motors.command("set 1 missed 400")
    motors.step(5)
    telemetry = motors.demand({})
    assert telemetry.channels[1].missed_edges == 255
    assert telemetry.channels[1].reason is Reason.ENCODER_EDGES


def test_a_low_supply_is_kept_until_the_next_telemetry(motors: VirtualBoard) -> None:
    assert not motors.demand({}).supply_low
    motors.command("supply_low 1")
    motors.step(2)
    motors.command("supply_low 0")
    motors.step(5)
    assert motors.demand({}).supply_low
    motors.step(1)
    assert not motors.demand({}).supply_low


@pytest.mark.parametrize(("role", "bridges"), [("motor", 0b1111), ("pressure", 0)])
def test_hello_names_bridges_and_the_scale_of_its_inputs(board: Make, role: str, bridges: int) -> None:
    hello = board(role).ask(Type.HELLO)
    assert isinstance(hello, Hello)
    assert (hello.bridges, hello.adc_steps, hello.adc_mv) == (bridges, 4095, 3300)


def test_the_chip_stamps_telemetry_and_watches_its_supply() -> None:
    board = Sam3x(build_sketch())
    board.run_ms(20)
    board.usb.open()
    host = Host(board.ask_usb)
    host.configure(2)
    times = []
    for k in range(12):
        board.run_ms(3.0 + 0.137 * k)
        asked = board.cpu.cycles / 84
        host.demand({})
        assert host.telemetry is not None
        assert not host.telemetry.supply_low
        composed = host.telemetry.uptime_ms * 1000 + host.telemetry.age_us
        times.append((asked, composed, board.cpu.cycles / 84))
    low = max(asked - composed for asked, composed, _ in times)
    high = min(received - composed for _, composed, received in times)
    assert low <= high, "board time is host time plus one constant, within every exchange"
    assert len({composed % 1000 for _, composed, _ in times}) > 6
    assert board.supply.words[4] == 0x10B, "continuous, 3.0 V"
    board.supply.millivolt = 2950
    board.run_ms(2)
    host.demand({})
    assert host.telemetry is not None
    assert host.telemetry.supply_low
