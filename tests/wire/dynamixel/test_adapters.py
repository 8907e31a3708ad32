"""Adapters that are late, batch, stall or share the bus: a value may be missing, never another one's."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from typing import Any

import pytest

from contid.errors import DeviceError
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.client import NoAnswerError, ServoClient
from contid_drivers.dynamixel.port import ServoPort

pytestmark = pytest.mark.realtime

TICK = reg.RAD_PER_TICK
Make = Callable[..., Any]
#: Registers of equal width with values of their own.
DISTINCT = {reg.POSITION_P: 401, reg.POSITION_I: 402, reg.POSITION_D: 403, reg.VELOCITY_I: 404}


def read_under(r: Any, disturb: Callable[[], None], count: int) -> int:
    """Read registers in random order; returns how many were read, none of them wrong."""
    for register, value in DISTINCT.items():
        r.emulator.servos[0].put(register, value)
    port = ServoPort("servos", r.emulator.port, r.options.baud, 0.0015)
    port.open()
    client, dice, good = ServoClient("servos", port), random.Random(7), 0
    try:
        for _ in range(count):
            disturb()
            register = dice.choice(tuple(DISTINCT))
            try:
                assert client.read(1, register) == DISTINCT[register], register.name
                good += 1
            except NoAnswerError:
                pass
    finally:
        port.close()
    return good


@pytest.mark.parametrize("ms", [33, 38, 44, 52, 61])
def test_a_register_read_through_a_late_adapter_is_never_another_register(rig: Make, ms: float) -> None:
    r = rig(1)
    r.emulator.set("late", ms=ms)
    read_under(r, lambda: None, 12)


def test_a_register_read_after_stalls_is_never_another_register(rig: Make) -> None:
    r = rig(1)
    dice = random.Random(3)

    def stall() -> None:
        if dice.random() < 0.4:
            r.emulator.set("hiccup", ms=dice.uniform(25, 80))

    assert read_under(r, stall, 60) >= 50


def test_a_write_through_a_late_adapter_is_not_confirmed_by_an_earlier_one(rig: Make) -> None:
    r = rig(1)
    port = ServoPort("servos", r.emulator.port, r.options.baud, 0.0015)
    port.open()
    client = ServoClient("servos", port)
    try:
        r.emulator.set("hiccup", ms=70)
        client.write(1, reg.POSITION_P, 500)
        r.emulator.set("silent", 1)
        with pytest.raises(DeviceError):
            client.write(1, reg.POSITION_P, 600)
        assert r.emulator.servo(1).get(reg.POSITION_P) == 500
    finally:
        port.close()


@pytest.mark.parametrize(
    "switches",
    [
        [("latency", {"ms": 1})],
        [("chunks", {"count": 7})],
        [("latency", {"ms": 1}), ("chunks", {"count": 3})],
    ],
    ids=["1 ms latency timer", "chunks", "both"],
)
@pytest.mark.parametrize("fast", ["auto", "off"])
def test_batches_and_pieces_cost_no_sample(rig: Make, switches: Any, fast: str) -> None:
    r = rig(3, fast_read=fast)
    for kind, values in switches:
        r.emulator.set(kind, **values)
    r.bus.open()
    r.bus.enable(r.bus.axes)
    for _ in range(50):
        samples = r.tick(a1=1000 * TICK)
        assert all(sample.valid and not sample.fault for sample in samples.values())
        time.sleep(0.001)
