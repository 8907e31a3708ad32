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


@pytest.mark.parametrize("fast", ["auto", "off"])
@pytest.mark.parametrize("ms", [3, 4, 5, 7, 9, 12, 16])
def test_samples_of_a_late_adapter_belong_to_their_exchange_or_are_invalid(
    rig: Make, ms: float, fast: str
) -> None:
    """The shafts stand elsewhere in every exchange, so a sample shows the exchange it was measured in."""
    r = rig(3, fast_read=fast, usb_latency_ms=1.5, retry_ms=2.0, slack_ms=1.0)
    r.bus.open()
    r.emulator.set("late", ms=ms)
    stale = valid = 0
    for k in range(60):
        with r.emulator._lock:
            for servo in r.emulator.servos:
                servo.motion.position = 1000.0 * servo.device + 7 * k
        for i, sample in enumerate(r.tick().values(), start=1):
            if sample.valid:
                valid += 1
                stale += sample.value != pytest.approx((1000 * i + 7 * k) * TICK, abs=TICK / 2)
        time.sleep(0.0025)
    assert stale == 0
    if ms > 6:
        assert r.bus._cyclic.counts.late > 0
    r.emulator.set("late", ms=0)
    r.until(lambda: all(sample.valid for sample in r.tick().values()))


def test_random_stalls_never_yield_a_sample_of_another_exchange(rig: Make) -> None:
    r = rig(2, usb_latency_ms=1.5, retry_ms=2.0, telemetry_every=5)
    r.bus.open()
    dice, valid = random.Random(5), 0
    for k in range(300):
        if dice.random() < 0.15:
            r.emulator.set("hiccup", ms=dice.uniform(1, 25))
        with r.emulator._lock:
            for servo in r.emulator.servos:
                servo.motion.position = 1000.0 * servo.device + 7 * k
        for i, sample in enumerate(r.tick().values(), start=1):
            valid += sample.valid
            assert not sample.valid or sample.value == pytest.approx((1000 * i + 7 * k) * TICK, abs=TICK / 2)
    assert valid > 300


def test_a_stall_of_a_scheduler_tick_costs_no_sample(rig: Make) -> None:
    r = rig(3, usb_latency_ms=1.5, retry_ms=2.0)
    r.bus.open()
    for _ in range(20):
        r.emulator.set("hiccup", ms=4.3)
        assert all(sample.valid for sample in r.tick().values())
        r.tick()


def test_a_second_host_on_the_bus_yields_no_wrong_sample(rig: Make) -> None:
    r = rig(3)
    r.bus.open()
    r.bus.enable(r.bus.axes)
    r.emulator.set("host", hz=60)
    for _ in range(100):
        for i, sample in enumerate(r.tick().values(), start=1):
            assert not sample.valid or sample.value == pytest.approx(1000 * i * TICK, abs=TICK)
        time.sleep(0.002)
    r.emulator.set("host", hz=0)
    r.until(lambda: all(sample.valid for sample in r.tick().values()))


def test_arming_many_servos_through_a_slow_adapter_does_not_outlive_the_watchdog(rig: Make) -> None:
    r = rig(16, watchdog_ms=200)
    r.bus.open()
    r.emulator.set("latency", ms=4)
    r.bus.enable(r.bus.axes)
    samples = r.tick()
    assert [sample.fault for sample in samples.values()] == [""] * 16
    for servo in r.emulator.servos:
        assert servo.torque
        assert servo.get(reg.BUS_WATCHDOG) == 10


def test_a_silent_servo_is_asked_last(rig: Make) -> None:
    r = rig(3, fast_read="off")
    r.bus.open()
    r.emulator.set("silent", 1)
    r.tick(3)
    assert r.bus._cyclic.ids == (2, 3, 1)
    r.emulator.set("silent", 1, on=False)
    r.until(lambda: all(sample.valid for sample in r.tick().values()))
    assert set(r.bus._cyclic.ids) == {1, 2, 3}
