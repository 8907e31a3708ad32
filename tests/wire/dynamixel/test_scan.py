"""Servos of Protocol 1.0 are named; a scan of the usual rates is short."""

from __future__ import annotations

import os
import threading
import tty
from collections.abc import Iterator

import pytest

from contid_devices.dynamixel.scan import PROTOCOL_1_S, USUAL_BAUDS, protocol_1, scan
from contid_drivers.dynamixel.client import PING_SIZE, PING_SLOT_S
from contid_drivers.dynamixel.packets import BROADCAST, STATUS_OVERHEAD
from contid_drivers.dynamixel.port import ServoPort

pytestmark = [pytest.mark.process, pytest.mark.realtime]

# Packets of the e-manual, Protocol 1.0, sections Ping and Read, for id 1; model number 12 is an AX-12.
PING_ALL = bytes.fromhex("fffffe0201fe")
PING_ANSWER = bytes.fromhex("ffff010200fc")
READ_MODEL = bytes.fromhex("ffff0104020002f6")
MODEL_ANSWER = bytes.fromhex("ffff0104000c00ee")


@pytest.fixture
def ax12() -> Iterator[str]:
    """A pseudo terminal on which an AX-12 answers, with its echo."""
    far, near = os.openpty()
    tty.setraw(near)
    stop = threading.Event()

    def serve() -> None:
        received = b""
        os.set_blocking(far, False)
        while not stop.wait(0.002):
            try:
                received += os.read(far, 4096)
            except BlockingIOError:
                continue
            for request, answer in ((PING_ALL, PING_ANSWER), (READ_MODEL, MODEL_ANSWER)):
                if request in received:
                    os.write(far, request + answer)
                    received = b""

    thread = threading.Thread(target=serve)
    thread.start()
    yield os.ttyname(near)
    stop.set()
    thread.join()
    os.close(far)
    os.close(near)


def test_a_servo_of_protocol_1_is_found_with_its_model(ax12: str) -> None:
    port = ServoPort("bench", ax12, 1000000, 0.02)
    assert protocol_1(port) == {1: 12}
    port.close()


def test_scan_reports_it_as_not_supported(ax12: str) -> None:
    found = scan([ax12], [1000000], lambda line: None)
    assert [(each.address, each.model) for each in found] == [(1, "ax-12 (Protocol 1.0, not supported)")]


def test_the_usual_rates_wait_less_than_three_seconds() -> None:
    slots_s = sum(PING_SLOT_S + (PING_SIZE + STATUS_OVERHEAD) * 10 / baud for baud in USUAL_BAUDS)
    assert BROADCAST * slots_s + len(USUAL_BAUDS) * 2 * PROTOCOL_1_S < 3.0
