"""The client of single servos, with the stock SDK on the same emulated bus as the oracle."""

from __future__ import annotations

import os
import tty
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import dynamixel_sdk as sdk
import pytest

from contid.errors import DeviceError, DeviceLostError, DeviceNotFoundError
from contid_devices.dynamixel.commission import sdk_bus
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.client import NoAnswerError, ServoClient, ServoRefusedError
from contid_drivers.dynamixel.packets import (
    STATUS_ERROR_TEXT,
    Instruction,
    build,
    read_parameters,
    sync_read,
    sync_write,
)
from contid_drivers.dynamixel.port import ServoPort
from contid_emulate.dynamixel import DynamixelEmulator, Servo

pytestmark = pytest.mark.realtime

BAUD = 1000000
STOCK = sdk.PacketHandler(2.0)


@pytest.fixture
def emulator() -> Iterator[DynamixelEmulator]:
    made = [Servo(1, position_ticks=-131073.0), Servo(4, model=1190, firmware=44), Servo(252)]
    with DynamixelEmulator(made, paced=False) as bus:
        yield bus


@pytest.fixture
def client(emulator: DynamixelEmulator) -> Iterator[ServoClient]:
    port = ServoPort("servos", emulator.port, BAUD, 0.02)
    yield ServoClient("servos", port)
    port.close()


@pytest.fixture
def stock(client: ServoClient) -> Any:
    """The SDK's own port handler on the port of the client; the two take turns."""
    assert client.port.serial is not None
    client.port.serial.timeout = 0.005  # the SDK must not spin against the emulator's thread
    handler = sdk.PortHandler(client.port.path)
    handler.ser, handler.is_open, handler.baudrate = client.port.serial, True, BAUD
    handler.tx_time_per_byte = 1e4 / BAUD
    return handler


def succeeded(request: Callable[[], tuple[Any, ...]], result: int) -> tuple[Any, ...]:
    """Repeat a request of the SDK whose fixed 34 ms ran out on a busy machine; ``result`` is its index."""
    for _ in range(5):
        if (answer := request())[result] == sdk.COMM_SUCCESS:
            return answer
    raise AssertionError(sdk.PacketHandler(2.0).getTxRxResult(answer[result]))


def test_ping_and_broadcast_ping_agree_with_the_sdk(client: ServoClient, stock: Any) -> None:
    for device in (1, 4, 252):
        assert client.ping(device) == succeeded(partial(STOCK.ping, stock, device), 1)[0]
    assert client.ping(9, tries=1) is None
    found, result = STOCK.broadcastPing(stock)
    assert result == sdk.COMM_SUCCESS
    assert client.broadcast_ping() == {device: tuple(data) for device, data in found.items()}


@pytest.mark.process
@pytest.mark.parametrize(
    "register", [r for r in reg.TABLE if r is not reg.REALTIME_TICK], ids=lambda register: register.name
)
def test_every_register_reads_as_in_the_sdk(client: ServoClient, stock: Any, register: reg.Register) -> None:
    data, *_ = succeeded(lambda: STOCK.readTxRx(stock, 4, register.address, register.size), 1)
    assert client.read_block(4, register.address, register.size) == bytes(data)


@pytest.mark.parametrize("value", [1234, 0, -1])
def test_writes_of_one_side_are_read_by_the_other(client: ServoClient, stock: Any, value: int) -> None:
    client.write(1, reg.OPERATING_MODE, 4)
    client.write(1, reg.GOAL_POSITION, value)
    data, *_ = succeeded(lambda: STOCK.readTxRx(stock, 1, reg.GOAL_POSITION.address, 4), 1)
    assert reg.GOAL_POSITION.decode(bytes(data)) == value
    assert succeeded(lambda: STOCK.write4ByteTxRx(stock, 1, reg.GOAL_POSITION.address, 77), 0)[1] == 0
    assert client.read(1, reg.GOAL_POSITION) == 77


def test_refusals_have_the_number_of_the_sdk(client: ServoClient, stock: Any) -> None:
    for register, value in ((reg.PRESENT_POSITION, 0), (reg.BUS_WATCHDOG, 200), (reg.GOAL_POSITION, 5000)):
        data = list(register.encode(value))
        at, size = register.address, register.size

        def write(at: int = at, size: int = size, data: list[int] = data) -> tuple[int, int]:
            return STOCK.writeTxRx(stock, 1, at, size, data)  # type: ignore[no-any-return]  # no types

        _, error = succeeded(write, 0)
        with pytest.raises(
            ServoRefusedError, match=rf"servo 1: .* refused: .*{STATUS_ERROR_TEXT[error][:9]}"
        ):
            client.write(1, register, value)


def test_a_silent_servo_raises_with_its_name(client: ServoClient) -> None:
    with pytest.raises(NoAnswerError, match=r"servos, servo 9: no answer \(reading register 132\)"):
        client.read(9, reg.PRESENT_POSITION)


@pytest.fixture
def line() -> Iterator[tuple[Any, int]]:
    """The SDK's port handler on one end of a pseudo terminal, the descriptor of the other end."""
    far, near = os.openpty()
    tty.setraw(near)
    handler = sdk.PortHandler(os.ttyname(near))
    handler.openPort()
    yield handler, far
    handler.closePort()
    os.close(near)
    os.close(far)


def goal_of(value: int) -> bytes:
    return reg.GOAL_POSITION.address.to_bytes(2, "little") + reg.GOAL_POSITION.encode(value)


SENT = {
    "read": (lambda h: STOCK.readTx(h, 7, 132, 4), build(7, Instruction.READ, read_parameters(132, 4))),
    "write": (lambda h: STOCK.write4ByteTxOnly(h, 7, 116, 1234), build(7, Instruction.WRITE, goal_of(1234))),
    "sync read": (lambda h: STOCK.syncReadTx(h, 132, 4, [1, 9], 2, False), sync_read(132, 4, [1, 9])),
    "fast sync read": (
        lambda h: STOCK.syncReadTx(h, 132, 4, [1, 9], 2, True),
        sync_read(132, 4, [1, 9], True),
    ),
    "sync write": (
        lambda h: STOCK.syncWriteTxOnly(h, 98, 1, [1, 5, 9, 5], 4),
        sync_write(98, 1, [(1, b"\5"), (9, b"\5")]),
    ),
}


@pytest.mark.parametrize(("send", "wire"), SENT.values(), ids=SENT)
def test_packets_are_those_of_the_sdk(line: tuple[Any, int], send: Callable[[Any], Any], wire: bytes) -> None:
    handler, far = line
    send(handler)
    assert os.read(far, 100) == wire


def test_the_sdk_sends_header_bytes_without_stuffing(line: tuple[Any, int]) -> None:
    # The reason for the driver's own codec; fails once an SDK release repairs txPacket.
    handler, far = line
    STOCK.write4ByteTxOnly(handler, 7, 116, -131073 & 0xFFFFFFFF)
    goal = b"\xff\xff\xfd\xff"
    assert goal in os.read(far, 100)
    stuffed = b"\xff\xff\xfd\xfd\xff"
    assert stuffed in build(7, Instruction.WRITE, goal_of(-131073))


def test_the_sdk_bus_of_commissioning_is_exclusive_and_reports_an_unplug(emulator: DynamixelEmulator) -> None:
    with sdk_bus(emulator.port, BAUD) as bus:
        assert bus.broadcast_ping() == {1: (1200, 52), 4: (1190, 44), 252: (1200, 52)}
        with pytest.raises(DeviceNotFoundError, match="in use by"), sdk_bus(emulator.port, BAUD):
            pass
        with pytest.raises(DeviceError, match="servo 9"):
            bus.read(9, reg.ID)
    with pytest.raises(DeviceLostError, match="is gone"), sdk_bus(emulator.port, BAUD) as bus:  # noqa: PT012
        emulator.set("unplug")
        bus.answers(1)
