"""Two servos with one id: found before anything is written to both, and named as the cause."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any, cast

import pytest

from contid.errors import DeviceError, DeviceNotFoundError
from contid_devices.dynamixel.commission import set_baud, set_id
from contid_drivers.dynamixel import duplicates
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.packets import STATUS_OVERHEAD, build_status
from contid_drivers.dynamixel.port import ServoPort
from contid_emulate.dynamixel import DynamixelEmulator, Servo

pytestmark = pytest.mark.realtime


@pytest.fixture
def emulated() -> Iterator[Callable[..., DynamixelEmulator]]:
    with ExitStack() as stack:

        def start(*servos: Servo) -> DynamixelEmulator:
            return stack.enter_context(DynamixelEmulator(servos, paced=False))

        yield start


def twins() -> tuple[Servo, Servo]:
    """Two servos of id 1, equal but for their position."""
    return Servo(1, position_ticks=700.0), Servo(1, position_ticks=3001.0)


def test_set_id_and_set_baud_refuse_two_servos_of_one_id(emulated: Callable[..., DynamixelEmulator]) -> None:
    bus = emulated(*twins())
    with pytest.raises(DeviceError, match="two servos have this id"):
        set_id(bus.port, 1000000, 1, 2)
    with pytest.raises(DeviceError, match="both would change"):
        set_baud(bus.port, 1000000, 1, 57600)
    assert [(servo.device, servo.baud) for servo in bus.servos] == [(1, 1000000)] * 2


@pytest.mark.process
def test_set_id_changes_the_only_servo_also_under_noise(emulated: Callable[..., DynamixelEmulator]) -> None:
    bus = emulated(Servo(1))
    bus.set("corrupt", 1, count=2)
    set_id(bus.port, 1000000, 1, 2)
    assert [servo.device for servo in bus.servos] == [2]
    with pytest.raises(DeviceError, match="no answer at 1000000 baud"):
        set_id(bus.port, 1000000, 1, 3)


def test_opening_a_bus_names_the_two_servos(rig: Callable[..., Any]) -> None:
    made = twins()
    for servo in made:
        servo.put(reg.RETURN_DELAY, 0)
    r = rig(1, made=made)
    with pytest.raises(DeviceNotFoundError, match=r"id 1 \(r.a1\): .*two servos have this id") as raised:
        r.bus.open()
    assert "one servo at a time" in raised.value.remedy


class SlowAdapter:
    """Hands bytes on when its latency timer ends, so an answer comes in two parts; nothing waits."""

    return_delay_s, byte_s = 5e-4, 10 / 57600
    latency_s = 0.02

    def __init__(self, twins: bool) -> None:
        self.now = 0.0
        self._twins = twins
        self._due: list[tuple[float, bytes]] = []

    def status_s(self, size: int) -> float:
        return (size + STATUS_OVERHEAD) * self.byte_s

    def flush(self) -> None:
        self._due.clear()

    def send(self, request: bytes) -> float:
        first, second = build_status(1, 0, bytes(16)), build_status(1, 0, bytes(range(16)))
        self._due = [(self.now + 0.002, first[:20]), (self.now + 0.018, first[20:])]
        if self._twins:
            self._due.append((self.now + 0.034, second))
        return self.now

    def receive(self, deadline: float) -> bytes:
        if not self._due or self._due[0][0] > deadline:
            return b""
        self.now, data = self._due.pop(0)
        return data


@pytest.mark.parametrize("twins", [False, True])
def test_an_answer_in_two_parts_is_one_servo(monkeypatch: pytest.MonkeyPatch, twins: bool) -> None:
    """FTDI's latency timer is 16 ms unless it is set (AN232B-04); new servos have 57600 baud."""
    port = SlowAdapter(twins)
    monkeypatch.setattr("time.monotonic", lambda: port.now)
    found = duplicates.count_answers(cast(ServoPort, port), 1)
    assert found.duplicated == twins
    assert found.single == (0 if twins else duplicates.READS)
