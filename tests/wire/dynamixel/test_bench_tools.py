"""Registers by name, blinking, factory reset and numbering on the emulated bus."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from contid.control.engine.cycle import RealClock
from contid.errors import DeviceError
from contid.hal import AxisOnBus, Rest
from contid_devices.dynamixel import bench_tools
from contid_devices.dynamixel.commission import reboot, set_id
from contid_devices.dynamixel.setup import setup
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.bus import DynamixelBus
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions
from contid_emulate.dynamixel import DynamixelEmulator, Servo

pytestmark = pytest.mark.realtime

BAUD = 1000000
Start = Callable[..., DynamixelEmulator]


@pytest.fixture
def emulated() -> Iterator[Start]:
    with ExitStack() as stack:

        def start(*servos: Servo) -> DynamixelEmulator:
            return stack.enter_context(DynamixelEmulator(servos, paced=False))

        yield start


def test_registers_are_read_by_name_and_address_with_the_unit_of_the_model(emulated: Start) -> None:
    bus = emulated(Servo(3, model=1020, position_ticks=1234.0))
    names = ("present_position", "goal-current", "144", "id")
    position, goal, voltage, number = bench_tools.read(bus.port, BAUD, 3, names)
    assert (position.value, position.address, position.unit) == (1234, 132, "tick")
    assert (goal.value, goal.unit) == (1193, "2.69 mA")
    assert (voltage.name, voltage.value, voltage.unit) == ("present input voltage", 120, "0.1 V")
    assert number.value == 3
    every = bench_tools.read(bus.port, BAUD, 3, ())
    assert len(every) > 40
    assert not [each for each in every if each.name.startswith("indirect")]
    with pytest.raises(DeviceError, match="did you mean present position"):
        bench_tools.read(bus.port, BAUD, 3, ["presnt_position"])


@pytest.mark.process
def test_a_register_is_written_within_its_range_and_torque_lock(emulated: Start) -> None:
    bus = emulated(Servo(1))
    assert bench_tools.write(bus.port, BAUD, 1, "position_p_gain", 800) == 800
    assert bus.servo(1).get(reg.POSITION_P) == 800
    for name, value, message in (
        ("position_p_gain", 16384, "allowed 0 to 16383"),
        ("present_position", 1, "read-only"),
        ("goal_position", 1, "moves the servo"),
        ("torque_enable", 1, "old goal"),
        ("id", 2, "set-id"),
        ("status_return_level", 0, "does not answer"),
    ):
        with pytest.raises(DeviceError, match=message):
            bench_tools.write(bus.port, BAUD, 1, name, value)
    bus.servo(1).put(reg.TORQUE_ENABLE, 1)
    with pytest.raises(DeviceError, match="torque is on and locks drive mode"):
        bench_tools.write(bus.port, BAUD, 1, "drive_mode", 1)
    assert bench_tools.write(bus.port, BAUD, 1, "torque_enable", 0) == 0


@pytest.mark.process
def test_a_request_without_an_answer_names_the_cause(emulated: Start) -> None:
    bus = emulated(Servo(1))
    with pytest.raises(DeviceError, match="servo 7: no answer at 1000000 baud"):
        bench_tools.blink(bus.port, BAUD, 7, 1)
    bus.set("corrupt", 1, count=50)
    with pytest.raises(DeviceError, match="broken answers: two servos have this id, or the cable is bad"):
        bench_tools.blink(bus.port, BAUD, 1, 1)
    bus.set("corrupt", 1, count=0)
    for level in (0, 1):
        bus.servo(1).put(reg.STATUS_RETURN_LEVEL, level)
        with pytest.raises(
            DeviceError, match=r"answers a ping, .* Status Return Level \(68\) is below 2"
        ) as raised:
            bench_tools.blink(bus.port, BAUD, 1, 1)
        assert "contid servo reboot" in raised.value.remedy
    reboot(bus.port, BAUD, 1)
    bench_tools.blink(bus.port, BAUD, 1, 1)


def test_a_reboot_that_arrives_damaged_is_repeated_or_refused(emulated: Start) -> None:
    bus = emulated(Servo(1))
    servo = bus.servo(1)
    servo.put(reg.LED, 1)
    bus.set("misread", 1, count=2)  # the ping before, and the order
    reboot(bus.port, BAUD, 1)
    assert servo.get(reg.LED) == 0
    servo.put(reg.LED, 1)
    bus.set("misread", 1, count=200)
    with pytest.raises(DeviceError, match="servo 1: it does not restart"):
        reboot(bus.port, BAUD, 1)
    assert servo.get(reg.LED) == 1


def test_nothing_is_written_to_two_servos_of_one_id(emulated: Start) -> None:
    bus = emulated(Servo(1, position_ticks=5.0), Servo(1, position_ticks=3000.0))
    with pytest.raises(DeviceError):
        bench_tools.write(bus.port, BAUD, 1, "position_p_gain", 800)
    with pytest.raises(DeviceError, match="two servos have this id"):
        bench_tools.reset(bus.port, BAUD, 1)
    assert [servo.get(reg.POSITION_P) for servo in bus.servos] == [400, 400]


def test_blinking_leaves_the_led_as_it_was(emulated: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_tools, "BLINK_S", 0.05)
    bus = emulated(Servo(1))
    bus.servo(1).put(reg.LED, 1)
    seen = set()
    thread = threading.Thread(target=bench_tools.blink, args=(bus.port, BAUD, 1, 4))
    thread.start()
    while thread.is_alive():
        seen.add(bus.servo(1).get(reg.LED))
        time.sleep(0.005)
    thread.join()
    assert seen == {0, 1}
    assert bus.servo(1).get(reg.LED) == 1


@pytest.mark.process
def test_a_reset_keeps_id_and_baud_rate(emulated: Start) -> None:
    bus = emulated(Servo(9))
    bus.servo(9).put(reg.RETURN_DELAY, 0)
    bus.servo(9).put(reg.OPERATING_MODE, 4)
    bench_tools.reset(bus.port, BAUD, 9)
    servo = bus.servo(9)
    assert (servo.device, servo.baud, servo.get(reg.RETURN_DELAY)) == (9, BAUD, 250)
    assert servo.get(reg.OPERATING_MODE) == 3
    servo.put(reg.TORQUE_ENABLE, 1)
    with pytest.raises(DeviceError, match="torque is on"):
        bench_tools.reset(bus.port, BAUD, 9)


def test_setup_numbers_new_servos_one_after_the_other(emulated: Start) -> None:
    """Two new servos (id 1, 57600 baud) and one of another model, plugged in as asked for."""
    new = [Servo(1, baud=57600, position_ticks=100.0 * i, model=1200) for i in range(2)]
    other = Servo(1, baud=57600, model=1190)
    bus = emulated(*new, other)
    plugged: list[Servo] = []
    bus.servos = ()
    requests: list[str] = []
    lines: list[str] = []

    def ask(request: str) -> None:
        requests.append(request)
        if len(requests) == 1:
            bus.servos = (other,)
            return
        plugged.append(new[len(plugged)])
        bus.servos = tuple(plugged)

    axes = [AxisOnBus(f"r.a{i}", DynamixelAxisOptions(id=i), None) for i in (7, 1)]
    setup("servos", DynamixelBusOptions(port=bus.port), axes, ask, lines.append)
    assert [(servo.device, servo.baud) for servo in new] == [(7, BAUD), (1, BAUD)]
    assert (other.device, other.baud) == (1, 57600)
    assert [request.partition(" (")[0] for request in requests] == [
        "Plug in the servo of r.a7", "Plug in the servo of r.a7", "Plug in the servo of r.a1",
    ]  # fmt: skip
    assert any("it is a xl330-m077" in line for line in lines)


@pytest.mark.parametrize("ids", [(1, 2), (3, 4)])
def test_setup_numbers_both_servos_of_one_body(emulated: Start, ids: tuple[int, int]) -> None:
    """The first axis is the shaft of id 2; with ids 1 and 2 each wants the id that the other has."""
    pair = [Servo(i, baud=57600, model=1090) for i in (1, 2)]
    bus = emulated(*pair)
    lines: list[str] = []
    turned = iter([(), (1,), ()])

    def ask(request: str) -> None:
        if "two shafts" in request:
            for i in next(turned):
                pair[i].motion.position += 900.0

    axes = [AxisOnBus(f"r.a{i}", DynamixelAxisOptions(id=i, model="2xl430-w250"), None) for i in ids]
    setup("servos", DynamixelBusOptions(port=bus.port), axes, ask, lines.append)
    assert "the shafts turned by 0 and 0 deg" in lines
    assert [(servo.device, servo.baud) for servo in pair] == [(ids[1], BAUD), (ids[0], BAUD)]


def test_setup_finds_a_servo_at_an_unusual_rate_beside_numbered_ones(emulated: Start) -> None:
    first, second = Servo(1, position_ticks=5.0), Servo(1, baud=2000000, position_ticks=900.0)
    bus = emulated(first)
    axes = [AxisOnBus(f"r.a{i}", DynamixelAxisOptions(id=i), None) for i in (1, 2)]

    def ask(request: str) -> None:
        if "r.a2" in request:
            bus.servos = (first, second)

    setup("servos", DynamixelBusOptions(port=bus.port), axes, ask, lambda line: None)
    assert [(servo.device, servo.baud) for servo in (first, second)] == [(1, BAUD), (2, BAUD)]


@pytest.mark.process
def test_a_run_begins_at_once_after_a_servo_got_another_id_and_its_own_again(emulated: Start) -> None:
    bus = emulated(Servo(1), Servo(2))
    options = DynamixelBusOptions(port=bus.port, usb_latency_ms=200, slack_ms=200)
    axes = [AxisOnBus(f"r.a{i}", DynamixelAxisOptions(id=i)) for i in (1, 2)]
    for _ in range(5):
        set_id(bus.port, BAUD, 1, 9)
        set_id(bus.port, BAUD, 9, 1)
        driver = DynamixelBus("servos", options, axes, RealClock())
        driver.open()
        driver.enable(driver.axes)
        for _ in range(10):
            samples = driver.exchange({})
            assert [(sample.valid, sample.fault) for sample in samples.values()] == [(True, "")] * 2
        assert driver.answer_counts()["late"] == 0
        driver.disable(driver.axes, Rest.RELAX)
        driver.close()
