"""Samples through adapters that are late: valid ones, and those of another exchange."""

from __future__ import annotations

import math
import time

from contid.control.engine.cycle import RealClock
from contid.hal import AxisOnBus
from contid_drivers.dynamixel.bus import DynamixelBus
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions


def late_samples(ms: float, count: int, fast: bool, exchanges: int = 190) -> tuple[int, int]:
    """Valid samples through an adapter late by ``ms``, and those among them of another exchange."""
    from contid_emulate.dynamixel import DynamixelEmulator, Servo

    servos = [Servo(i + 1, position_ticks=1000.0 * (i + 1)) for i in range(count)]
    with DynamixelEmulator(servos) as emulator:
        options = DynamixelBusOptions(port=emulator.port, fast_read="auto" if fast else "off")
        axes = [AxisOnBus(f"r.a{i + 1}", DynamixelAxisOptions(id=i + 1)) for i in range(count)]
        bus = DynamixelBus("servos", options, axes, RealClock())
        bus.open()
        emulator.set("late", ms=ms)
        valid = stale = 0
        due = time.monotonic()
        for k in range(exchanges):
            for i, servo in enumerate(servos):
                servo.motion.position = 1000.0 * (i + 1) + 7 * k
            for i, sample in enumerate(bus.exchange({}).values()):
                if sample.valid and sample.value is not None:
                    valid += 1
                    ticks = sample.value / (2.0 * math.pi) * 4096
                    stale += abs(ticks - 1000.0 * (i + 1) - 7 * k) > 0.6
            due += 0.005
            time.sleep(max(0.0, due - time.monotonic()))
        bus.close()
    return valid, stale


def late_total() -> tuple[int, int]:
    valid = stale = 0
    for fast in (False, True):
        for ms in (3, 4, 5, 7, 9, 12, 16):
            good, wrong = late_samples(ms, 4, fast)
            print(f"{ms:2d} ms late, {'fast' if fast else 'plain'} read: {good} of 760 valid, {wrong} wrong")
            valid, stale = valid + good, stale + wrong
    return valid, stale
