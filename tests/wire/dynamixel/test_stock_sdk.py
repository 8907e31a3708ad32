"""The emulator against the stock SDK as its client, unmodified: its conformance test."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import dynamixel_sdk as sdk
import pytest

from contid_emulate.dynamixel import DynamixelEmulator, Servo
from contid_emulate.dynamixel.machine import BOOT_S

pytestmark = [pytest.mark.process, pytest.mark.realtime]


@pytest.fixture
def bus() -> Iterator[DynamixelEmulator]:
    with DynamixelEmulator([Servo(i, position_ticks=1000.0 * i) for i in (1, 2, 3)]) as emulator:
        for servo in emulator.servos:
            servo.memory[9] = 0
        yield emulator


@pytest.fixture
def port(bus: DynamixelEmulator) -> Iterator[Any]:
    handler = sdk.PortHandler(bus.port)
    assert handler.setBaudRate(1000000)
    yield handler
    handler.closePort()


protocol = sdk.PacketHandler(2.0)


def test_ping_and_broadcast_ping(bus: DynamixelEmulator, port: Any) -> None:
    assert protocol.ping(port, 2) == (1200, sdk.COMM_SUCCESS, 0)
    assert protocol.ping(port, 9)[1] == sdk.COMM_RX_TIMEOUT
    found, result = protocol.broadcastPing(port)
    assert result == sdk.COMM_SUCCESS
    assert found == {i: [1200, 52] for i in (1, 2, 3)}


def test_read_and_write_of_every_width(bus: DynamixelEmulator, port: Any) -> None:
    assert protocol.write1ByteTxRx(port, 1, 65, 1) == (sdk.COMM_SUCCESS, 0)
    assert protocol.write2ByteTxRx(port, 1, 84, 640) == (sdk.COMM_SUCCESS, 0)
    assert protocol.write4ByteTxRx(port, 1, 112, 123) == (sdk.COMM_SUCCESS, 0)
    assert protocol.read1ByteTxRx(port, 1, 65) == (1, sdk.COMM_SUCCESS, 0)
    assert protocol.read2ByteTxRx(port, 1, 84) == (640, sdk.COMM_SUCCESS, 0)
    assert protocol.read4ByteTxRx(port, 1, 132) == (1000, sdk.COMM_SUCCESS, 0)


@pytest.mark.parametrize(
    ("address", "data", "error", "why"),
    [
        (132, [0, 0, 0, 0], 7, "present position is read-only"),
        (200, [0], 5, "half an indirect address"),
        (84, [1], 5, "half a gain"),
        (98, [200], 4, "watchdog beyond 127"),
        (102, [0xFF, 0x7F], 4, "current beyond its range"),
        (116, [0, 0, 1, 0], 6, "goal beyond the limits of position mode"),
    ],
)
def test_refusals_have_the_documented_numbers(
    bus: DynamixelEmulator, port: Any, address: int, data: list[int], error: int, why: str
) -> None:
    assert protocol.writeTxRx(port, 1, address, len(data), data) == (sdk.COMM_SUCCESS, error), why


def test_goal_current_beyond_the_current_limit_is_a_limit_error(bus: DynamixelEmulator, port: Any) -> None:
    assert protocol.write2ByteTxRx(port, 1, 38, 500) == (sdk.COMM_SUCCESS, 0)
    assert protocol.write2ByteTxRx(port, 1, 102, 501) == (sdk.COMM_SUCCESS, 6)


def test_eeprom_is_locked_under_torque(bus: DynamixelEmulator, port: Any) -> None:
    assert protocol.write1ByteTxRx(port, 1, 11, 4)[1] == 0
    assert protocol.write1ByteTxRx(port, 1, 64, 1)[1] == 0
    assert protocol.write1ByteTxRx(port, 1, 11, 3)[1] == 7


def test_registered_writes_wait_for_the_action(bus: DynamixelEmulator, port: Any) -> None:
    for device in (1, 2):
        assert protocol.regWriteTxRx(port, device, 65, 1, [1]) == (sdk.COMM_SUCCESS, 0)
        assert protocol.read1ByteTxRx(port, device, 69)[0] == 1
        assert protocol.read1ByteTxRx(port, device, 65)[0] == 0
    protocol.action(port, 1)
    time.sleep(0.01)
    port.clearPort()
    assert protocol.read1ByteTxRx(port, 1, 65)[0] == 1
    assert protocol.read1ByteTxRx(port, 2, 65)[0] == 0


@pytest.mark.parametrize("fast", [False, True])
def test_sync_read(bus: DynamixelEmulator, port: Any, fast: bool) -> None:
    group = sdk.GroupSyncRead(port, protocol, 132, 4)
    for device in (1, 2, 3):
        group.addParam(device)
    assert (group.fastSyncRead() if fast else group.txRxPacket()) == sdk.COMM_SUCCESS
    assert [group.getData(device, 132, 4) for device in (1, 2, 3)] == [1000, 2000, 3000]


@pytest.mark.parametrize("fast", [False, True])
def test_bulk_read(bus: DynamixelEmulator, port: Any, fast: bool) -> None:
    group = sdk.GroupBulkRead(port, protocol)
    group.addParam(1, 132, 4)
    group.addParam(2, 144, 2)
    group.addParam(3, 146, 1)
    assert (group.fastBulkRead() if fast else group.txRxPacket()) == sdk.COMM_SUCCESS
    assert [group.getData(1, 132, 4), group.getData(2, 144, 2), group.getData(3, 146, 1)] == [1000, 50, 25]


def test_sync_write_and_bulk_write(bus: DynamixelEmulator, port: Any) -> None:
    group = sdk.GroupSyncWrite(port, protocol, 112, 4)
    for device in (1, 2, 3):
        group.addParam(device, [device, 0, 0, 0])
    assert group.txPacket() == sdk.COMM_SUCCESS
    assert [protocol.read4ByteTxRx(port, device, 112)[0] for device in (1, 2, 3)] == [1, 2, 3]
    bulk = sdk.GroupBulkWrite(port, protocol)
    bulk.addParam(1, 65, 1, [1])
    bulk.addParam(2, 84, 2, [0x10, 0x01])
    assert bulk.txPacket() == sdk.COMM_SUCCESS
    assert protocol.read1ByteTxRx(port, 1, 65)[0] == 1
    assert protocol.read2ByteTxRx(port, 2, 84)[0] == 0x110


def test_reboot_loses_ram_and_turns(bus: DynamixelEmulator, port: Any) -> None:
    bus.servo(1).motion.position = 3 * 4096 + 77.0
    assert protocol.write1ByteTxRx(port, 1, 65, 1)[1] == 0
    assert protocol.read4ByteTxRx(port, 1, 132)[0] == 3 * 4096 + 77
    assert protocol.reboot(port, 1) == (sdk.COMM_SUCCESS, 0)
    assert protocol.ping(port, 1)[1] == sdk.COMM_RX_TIMEOUT
    time.sleep(BOOT_S)
    assert protocol.read1ByteTxRx(port, 1, 65)[0] == 0
    assert protocol.read4ByteTxRx(port, 1, 132)[0] == 77


def test_factory_reset_keeps_the_id_when_asked(bus: DynamixelEmulator, port: Any) -> None:
    protocol.write1ByteTxRx(port, 3, 11, 4)
    assert protocol.factoryReset(port, 3, 0x02) == (sdk.COMM_SUCCESS, 0)
    time.sleep(BOOT_S + 0.02)
    assert protocol.read1ByteTxRx(port, 3, 11)[0] == 3
    assert protocol.read1ByteTxRx(port, 3, 9)[0] == 250
    # Option 1 resets the baud rate as well, so the servo is deaf at this one from now on.
    assert protocol.factoryReset(port, 3, 0x01) == (sdk.COMM_SUCCESS, 0)
    time.sleep(BOOT_S)
    assert protocol.ping(port, 3)[1] == sdk.COMM_RX_TIMEOUT
    port.setBaudRate(57600)
    assert protocol.ping(port, 3) == (1200, sdk.COMM_SUCCESS, 0)


def test_clear_resets_the_turns(bus: DynamixelEmulator, port: Any) -> None:
    bus.servo(2).motion.position = 5 * 4096 + 9.0
    assert protocol.clearMultiTurn(port, 2) == (sdk.COMM_SUCCESS, 0)
    assert protocol.read4ByteTxRx(port, 2, 132)[0] == 9


def test_status_return_level_decides_who_answers(bus: DynamixelEmulator, port: Any) -> None:
    protocol.write1ByteTxRx(port, 1, 68, 1)
    assert protocol.write1ByteTxRx(port, 1, 65, 1)[0] == sdk.COMM_RX_TIMEOUT
    assert protocol.read1ByteTxRx(port, 1, 65)[0] == 1
    protocol.write1ByteTxOnly(port, 1, 68, 0)
    assert protocol.read1ByteTxRx(port, 1, 65)[1] == sdk.COMM_RX_TIMEOUT
    assert protocol.ping(port, 1)[1] == sdk.COMM_SUCCESS


def test_indirect_addresses_map_bytes(bus: DynamixelEmulator, port: Any) -> None:
    for i, address in enumerate((132, 133, 134, 135, 144)):
        assert protocol.write2ByteTxRx(port, 3, 168 + 2 * i, address) == (sdk.COMM_SUCCESS, 0)
    data, result, _ = protocol.readTxRx(port, 3, 208, 5)
    assert result == sdk.COMM_SUCCESS
    assert bytes(data) == (3000).to_bytes(4, "little") + b"\x32"
    assert protocol.write2ByteTxRx(port, 3, 168, 63) == (sdk.COMM_SUCCESS, 4)


def test_alert_is_in_every_answer(bus: DynamixelEmulator, port: Any) -> None:
    bus.set("overload", 1)
    value, result, error = protocol.read1ByteTxRx(port, 1, 70)
    assert (value, result, error & 0x80) == (0x20, sdk.COMM_SUCCESS, 0x80)
    assert protocol.write1ByteTxRx(port, 1, 64, 1)[1] & 0x7F == 1


def test_pwm_mode_begins_with_the_limit_refuses_more_and_ends_with_its_host(
    bus: DynamixelEmulator, port: Any
) -> None:
    """Registers 11, 36, 98 and 100 of the e-manual, which bound the pulses of a bring-up."""
    limit, mode, watchdog, goal, torque = 36, 11, 98, 100, 64
    assert protocol.write2ByteTxRx(port, 1, limit, 177) == (sdk.COMM_SUCCESS, 0)
    assert protocol.write1ByteTxRx(port, 1, mode, 16) == (sdk.COMM_SUCCESS, 0)
    assert protocol.read2ByteTxRx(port, 1, goal) == (177, sdk.COMM_SUCCESS, 0)
    assert protocol.write2ByteTxRx(port, 1, goal, 178) == (sdk.COMM_SUCCESS, 6)
    assert protocol.write2ByteTxRx(port, 1, goal, 0) == (sdk.COMM_SUCCESS, 0)
    assert protocol.write1ByteTxRx(port, 1, torque, 1) == (sdk.COMM_SUCCESS, 0)
    assert protocol.write1ByteTxRx(port, 1, watchdog, 1) == (sdk.COMM_SUCCESS, 0)
    assert protocol.write2ByteTxRx(port, 1, goal, 177) == (sdk.COMM_SUCCESS, 0)
    time.sleep(0.3)
    assert protocol.read1ByteTxRx(port, 1, watchdog) == (255, sdk.COMM_SUCCESS, 0)
    position = protocol.read4ByteTxRx(port, 1, 132)[0]
    # 20 ms of at most 0.16 of 7031 ticks/s and the way to a stop.
    assert 1000 < position < 1000 + 60
    assert protocol.write2ByteTxRx(port, 1, goal, 100) == (sdk.COMM_SUCCESS, 4)
    time.sleep(0.1)
    assert protocol.read4ByteTxRx(port, 1, 132)[0] == position
