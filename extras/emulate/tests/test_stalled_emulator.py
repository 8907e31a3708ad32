"""An emulator that did not run for a while does not blame the host for it."""

from __future__ import annotations

import time
from contextlib import closing

import pytest

from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.client import ServoClient
from contid_drivers.dynamixel.port import ServoPort
from contid_emulate.dynamixel import DynamixelEmulator, Servo

pytestmark = pytest.mark.realtime

WATCHDOG_S = 0.1


def test_the_watchdog_of_a_servo_does_not_count_the_time_its_emulator_stood_still() -> None:
    with (
        DynamixelEmulator([Servo(1)], paced=False) as emulator,
        closing(ServoPort("servos", emulator.port, 1000000, 0.5)) as port,
    ):
        client = ServoClient("servos", port)
        client.write(1, reg.TORQUE_ENABLE, 1)
        client.write(1, reg.BUS_WATCHDOG, round(WATCHDOG_S * 1e3 / reg.WATCHDOG_MS_PER_UNIT))
        with emulator._lock:  # stands for a process that the machine kept from running
            time.sleep(3 * WATCHDOG_S)
        assert client.read(1, reg.BUS_WATCHDOG) * reg.WATCHDOG_MS_PER_UNIT == WATCHDOG_S * 1e3
        time.sleep(3 * WATCHDOG_S)  # a host that is silent while the emulator runs
        assert client.read(1, reg.BUS_WATCHDOG) == reg.BUS_WATCHDOG.decode(bytes([reg.WATCHDOG_TRIPPED]))
