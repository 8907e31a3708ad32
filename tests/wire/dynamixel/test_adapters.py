"""Adapters that are late, batch, stall or share the bus: a value may be missing, never another one's.

No test depends on the speed of the machine: each goes on until it has seen enough, within `LONG_S`.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import count
from typing import Any

import pytest

from contid.errors import DeviceError
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.bus import STALLS_LOGGED
from contid_drivers.dynamixel.client import NoAnswerError, ServoClient
from contid_drivers.dynamixel.cycle_time import SLACK_MIN_S, WINDOW, Slack
from contid_drivers.dynamixel.exchange.cyclic import Cyclic
from contid_drivers.dynamixel.port import ServoPort

pytestmark = pytest.mark.realtime

TICK = reg.RAD_PER_TICK
Make = Callable[..., Any]
#: Far longer than any of these tests needs; only a defect lasts as long.
LONG_S = 120.0
#: Registers of equal width with values of their own.
DISTINCT = {reg.POSITION_P: 401, reg.POSITION_I: 402, reg.POSITION_D: 403, reg.VELOCITY_I: 404}


def enough(done: Callable[[], bool], minimum: int = 0) -> Iterator[int]:
    """Count up until ``done``, at least to ``minimum``, at most for `LONG_S`."""
    deadline = time.monotonic() + LONG_S
    for k in count():
        if k >= minimum and done():
            return
        assert time.monotonic() < deadline, f"not enough after {k} rounds"
        yield k


def read_under(r: Any, disturb: Callable[[], None], attempts: int, reads: int = 0) -> None:
    """Read registers in random order, none of them wrong, until ``reads`` succeeded."""
    for register, value in DISTINCT.items():
        r.emulator.servos[0].put(register, value)
    port = ServoPort("servos", r.emulator.port, r.options.baud, 0.0015)
    client, dice = ServoClient("servos", port), random.Random(7)
    good: list[int] = []
    try:
        for _ in enough(lambda: len(good) >= reads, attempts):
            disturb()
            register = dice.choice(tuple(DISTINCT))
            try:
                good.append(client.read(1, register))
                assert good[-1] == DISTINCT[register], register.name
            except NoAnswerError:
                pass
    finally:
        port.close()


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

    read_under(r, stall, 60, reads=50)


def test_a_write_through_a_late_adapter_is_not_confirmed_by_an_earlier_one(rig: Make) -> None:
    r = rig(1)
    port = ServoPort("servos", r.emulator.port, r.options.baud, 0.0015)
    client = ServoClient("servos", port)
    try:
        for _ in enough(lambda: r.emulator.servo(1).get(reg.POSITION_P) == 500):
            r.emulator.set("hiccup", ms=70)
            with suppress(NoAnswerError):
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
        pytest.param([("latency", {"ms": 1})], marks=pytest.mark.campaign, id="1 ms latency timer"),
        pytest.param([("chunks", {"count": 7})], marks=pytest.mark.campaign, id="chunks"),
        pytest.param([("latency", {"ms": 1}), ("chunks", {"count": 3})], id="both"),
    ],
)
@pytest.mark.parametrize("fast", ["auto", "off"])
def test_batches_and_pieces_cost_no_sample(rig: Make, switches: Any, fast: str) -> None:
    r = rig(3, fast_read=fast, usb_latency_ms=200, slack_ms=200, retry_ms=100)
    for kind, values in switches:
        r.emulator.set(kind, **values)
    r.bus.open()
    r.bus.enable(r.bus.axes)
    for _ in range(50):
        samples = r.tick(a1=1000 * TICK)
        assert all(sample.valid and not sample.fault for sample in samples.values())
        time.sleep(0.001)


@pytest.mark.process
@pytest.mark.parametrize("fast", ["auto", "off"])
@pytest.mark.parametrize(
    "ms", [3, *(pytest.param(k, marks=pytest.mark.campaign) for k in (4, 5, 9, 12)), 7, 16]
)
def test_samples_of_a_late_adapter_belong_to_their_exchange_or_are_invalid(
    rig: Make, ms: float, fast: str
) -> None:
    """The shafts stand elsewhere in every exchange, so a sample shows the exchange it was measured in."""
    r = rig(3, fast_read=fast, usb_latency_ms=1.5, retry_ms=2.0, slack_ms=1.0)
    r.bus.open()
    r.emulator.set("late", ms=ms)
    stale = 0
    for k in enough(lambda: ms <= 6 or r.bus.answer_counts()["late"] > 0, 60):
        with r.emulator._lock:
            for servo in r.emulator.servos:
                servo.motion.position = 1000.0 * servo.device + 7 * k
        for i, sample in enumerate(r.tick().values(), start=1):
            if sample.valid:
                stale += sample.value != pytest.approx((1000 * i + 7 * k) * TICK, abs=TICK / 2)
        time.sleep(0.0025)
    assert stale == 0
    r.emulator.set("late", ms=0)
    r.until(lambda: all(sample.valid for sample in r.tick().values()), LONG_S)


def test_random_stalls_never_yield_a_sample_of_another_exchange(rig: Make) -> None:
    r = rig(2, usb_latency_ms=1.5, retry_ms=2.0, telemetry_every=5)
    r.bus.open()
    dice = random.Random(5)
    valid: list[float] = []
    for k in enough(lambda: len(valid) >= 200, 300):
        if dice.random() < 0.15:
            r.emulator.set("hiccup", ms=dice.uniform(1, 25))
        with r.emulator._lock:
            for servo in r.emulator.servos:
                servo.motion.position = 1000.0 * servo.device + 7 * k
        for i, sample in enumerate(r.tick().values(), start=1):
            if sample.valid:
                valid.append(sample.value)
                assert sample.value == pytest.approx((1000 * i + 7 * k) * TICK, abs=TICK / 2)


def disturbed(cyclic: Cyclic) -> bool:
    return bool(cyclic.silent or cyclic.answers.counts.late)


def test_a_stall_longer_than_the_time_out_costs_no_sample(rig: Make) -> None:
    r = rig(3, usb_latency_ms=20, slack_ms=200, retry_ms=0)
    r.bus.open()
    stalls = r.bus.answer_counts()["stalls"]
    for _ in range(10):
        r.until(lambda: r.opened.cyclic.answers.received and not disturbed(r.opened.cyclic))
        r.emulator.set("hiccup", ms=50)
        assert all(sample.valid for sample in r.tick().values())
    assert r.bus.answer_counts()["stalls"] >= stalls + 10


@pytest.mark.process
def test_an_adapter_that_is_always_late_is_named_although_no_sample_is_lost(
    rig: Make, caplog: pytest.LogCaptureFixture
) -> None:
    r = rig(2, usb_latency_ms=1.5, slack_ms=200, retry_ms=0)
    r.bus.open()
    r.emulator.set("late", ms=12)
    for _ in range(STALLS_LOGGED + 5):
        r.tick()
    r.emulator.set("late", ms=0)
    (found,) = [record.getMessage() for record in caplog.records if "latency timer" in record.getMessage()]
    assert "after their time-out" in found


def test_a_stall_of_a_scheduler_tick_is_waited_for_from_the_start() -> None:
    """A process gets its bytes up to 4 ms late from a kernel at 250 Hz; none has been measured yet."""
    assert Slack("auto").seconds > 4e-3


def test_measured_lateness_widens_the_slack_by_its_percentile_and_not_by_one_outlier() -> None:
    slack = Slack("auto")
    for k in range(2 * WINDOW):
        slack.record(0.006 if k % 100 == 0 else 0.001)
    assert 0.006 < slack.seconds < 0.012
    slack.record(0.5)
    assert slack.seconds < 0.012
    for _ in range(2 * WINDOW):
        slack.record(0.001)
    assert slack.seconds == SLACK_MIN_S
    assert Slack(0.0).seconds == 0.0


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
    r.until(lambda: all(sample.valid for sample in r.tick().values()), LONG_S)


@pytest.mark.process
def test_arming_many_servos_through_a_slow_adapter_does_not_outlive_the_watchdog(rig: Make) -> None:
    r = rig(16, watchdog_ms=500)
    r.bus.open()
    r.emulator.set("latency", ms=10)
    before = time.monotonic()
    r.bus.enable(r.bus.axes)
    assert time.monotonic() - before > 1.0, "arming must last longer than the watchdog"
    samples = r.tick()
    assert [sample.fault for sample in samples.values()] == [""] * 16
    for servo in r.emulator.servos:
        assert servo.torque
        assert servo.get(reg.BUS_WATCHDOG) == 25


@pytest.mark.process
def test_a_silent_servo_is_asked_last(rig: Make) -> None:
    r = rig(3, fast_read="off")
    r.bus.open()
    r.emulator.set("silent", 1)
    r.until(lambda: r.opened.cyclic.ids == (2, 3, 1), LONG_S)
    r.emulator.set("silent", 1, on=False)
    r.until(lambda: all(sample.valid for sample in r.tick().values()), LONG_S)
    assert set(r.opened.cyclic.ids) == {1, 2, 3}
