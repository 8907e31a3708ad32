"""Emulated servos without a thread, in the time of their host (`tests.wire.wire_time`)."""

from __future__ import annotations

import select
from types import ModuleType

import pytest

from contid.kit import locked_port
from contid_drivers.dynamixel import bus, client, duplicates
from contid_emulate.dynamixel import DynamixelEmulator, wire
from tests.wire.wire_time import WireTime, wire_time


class InlineEmulator(DynamixelEmulator):
    """Serves its port when its host waits."""

    def start(self) -> None:
        now = wire.time.monotonic()  # type: ignore[attr-defined]  # the time in its place
        for servo in self.servos:
            servo.now = servo.booted_at = servo.fed_at = now
        self._plug()

    def stop(self) -> None:
        self._port.unplug()

    def turn(self, now_s: float) -> None:
        """Answer what has come; its time is that of the host."""
        while select.select([self._port.descriptor], [], [], 0.0)[0]:
            self._receive()
        self._deliver()
        self._idle()


def servo_time(monkeypatch: pytest.MonkeyPatch, *also: ModuleType) -> WireTime:
    """Host, with further modules of it, and emulators in one time until the test ends."""
    return wire_time(monkeypatch, (locked_port, bus, client, duplicates, wire, *also), (locked_port,))
