"""Servos that receive instructions damaged, and answer "CRC error": what was asked is asked again.

A status with this error means that nothing was done (e-manual, Protocol 2.0, Status Packet).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from contid.control.engine.ports import BusJob, perform
from contid.control.tick.state import Effect
from contid.errors import DeviceError
from contid.hal import Rest
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.checks import identity
from contid_drivers.dynamixel.client import BARRIER_SIZES, NoAnswerError
from contid_drivers.dynamixel.packets import Instruction
from contid_emulate.dynamixel import FaultSwitches, Servo
from tests.wire.dynamixel.virtual_wire import servo_time

Make = Callable[..., Any]
BOTH = ["r.a1", "r.a2"]


@pytest.fixture
def timed(rig: Make, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Rigs in virtual time."""

    def make(*args: Any, **options: Any) -> Any:
        return rig(*args, time=servo_time(monkeypatch), **options)

    return make


@pytest.fixture
def running(timed: Make) -> Any:
    """Two enabled servos."""
    r = timed()
    r.bus.open()
    r.bus.enable(BOTH)
    r.tick(2)
    return r


def test_an_instruction_that_arrived_damaged_is_repeated(running: Any) -> None:
    client, servo = running.opened.client, running.emulator.servos[0]
    running.emulator.set("misread", 1, count=2)
    client.write(1, reg.LED, 1)
    assert servo.get(reg.LED) == 1
    running.emulator.set("misread", 1, count=2)
    assert client.read(1, reg.LED) == 1
    running.emulator.set("misread", 1, count=2)
    assert client.ping(1) == 1200
    started = servo.booted_at
    running.emulator.set("misread", 1, count=2)
    client.reboot(1)
    assert servo.booted_at > started


def test_a_reboot_that_never_arrived_is_repeated(running: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    client, servo = running.opened.client, running.emulator.servos[0]
    started, send = servo.booted_at, client.port.send
    lost: list[bytes] = []

    def losing(packet: bytes) -> Any:
        if packet[7] == Instruction.REBOOT and not lost:
            lost.append(packet)
            return send(b"")
        return send(packet)

    monkeypatch.setattr(client.port, "send", losing)
    client.reboot(1)
    assert lost
    assert servo.booted_at > started


def test_a_servo_that_receives_only_damage_counts_as_silent_with_the_reason(running: Any) -> None:
    running.emulator.set("misread", 1, count=3)
    with pytest.raises(NoAnswerError, match=r"servo 1 \(r\.a1\): its instructions arrive damaged") as error:
        running.opened.client.read(1, reg.LED)
    assert "cable" in error.value.remedy
    running.emulator.set("misread", 1, count=3)
    assert running.opened.client.ping(1) is None


@pytest.mark.parametrize("count", [1, 2, 3, 6])
def test_a_relax_among_damaged_instructions_is_done_or_done_later(running: Any, count: int) -> None:
    """The engine gets "done" in either case, and no healthy neighbour is called faulty."""
    running.emulator.set("misread", 1, count=count)
    reply = perform(running.bus, BusJob({}, ((0, Effect.RELAX, tuple(BOTH)),)))
    assert (reply.lost, reply.refused) == ("", [])
    for _ in range(4):
        reply = perform(running.bus, BusJob({}))
        assert reply.samples is not None
        assert [sample.fault for sample in reply.samples.values()] == ["", ""]
    assert not any(servo.torque for servo in running.emulator.servos)


def test_a_relax_whose_packet_one_servo_lost_is_sent_again(
    running: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Noise at one servo: neither the sync write nor the read that is to confirm it arrive whole."""
    write, lost = Servo.write, [1]

    def noisy(servo: Servo, address: int, data: bytes) -> Any:
        if servo.device == 1 and address == reg.TORQUE_ENABLE.address and lost:
            running.emulator.faults.left["misread", 1] = lost.pop()
            return 0
        return write(servo, address, data)

    monkeypatch.setattr(Servo, "write", noisy)
    running.bus.disable(BOTH, Rest.RELAX)
    assert not any(servo.torque for servo in running.emulator.servos)
    assert [sample.fault for sample in running.tick(3).values()] == ["", ""]


def test_noise_while_a_pending_rest_is_confirmed_loses_no_bus(running: Any) -> None:
    running.emulator.set("silent", 1)
    running.bus.disable(["r.a1"], Rest.RELAX)
    running.emulator.set("silent", 1, on=False)
    for _ in range(3):
        running.emulator.set("misread", 1, count=2)  # what separates it from the one before, and the read
        reply = perform(running.bus, BusJob({}))
        assert (reply.lost, reply.samples is None) == ("", False)
    running.emulator.set("misread", 1, count=0)
    running.tick(2)
    assert not running.emulator.servos[0].torque


@pytest.mark.parametrize("layout", ["indirect", "plain"])
def test_noise_while_the_cause_of_an_alert_is_read_loses_no_bus(timed: Make, layout: str) -> None:
    made = [Servo(1), Servo(2, firmware=53 if layout == "plain" else 52)]
    r = timed(2, made=made, telemetry_every=1000)
    r.bus.open()
    r.bus.enable(BOTH)
    r.tick(2)
    r.emulator.set("alert", 1, bits=0x04)
    for _ in range(3):
        r.emulator.set("misread", 1, count=1)
        reply = perform(r.bus, BusJob({}))
        assert reply.lost == ""
    r.emulator.set("misread", 1, count=0)
    assert "overheated" in r.tick()["r.a1"].fault


def outcome(r: Any, disturbed: int, monkeypatch: pytest.MonkeyPatch) -> tuple[list[Any], int]:
    """A life of a bus with one damaged instruction: what each step gave, and the number of instructions."""
    counted, steps = [0], []

    def spent(self: FaultSwitches, kind: str, device: int) -> bool:
        if kind != "misread":
            return False
        counted[0] += 1
        return counted[0] == disturbed

    monkeypatch.setattr(FaultSwitches, "spent", spent)
    servos = r.emulator.servos
    for step in (
        r.bus.open,
        lambda: r.bus.enable(BOTH),
        lambda: r.bus.disable(BOTH, Rest.HOLD),
        lambda: r.bus.enable(BOTH),
        lambda: r.bus.disable(BOTH, Rest.RELAX),
        lambda: r.bus.clear_fault(BOTH),
    ):
        try:
            step()
            refused = ""
        except DeviceError as error:
            refused = str(error)
        ram = [[servo.get(each) for each in servo.table if each.writable] for servo in servos]
        steps.append((refused, [axis.state for axis in r.bus._states.values()], ram))
    r.bus.close()
    return steps, counted[0]


@pytest.mark.slow
@pytest.mark.parametrize("every", [7, pytest.param(1, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("case", ["new", "count_reset"])
def test_one_damaged_instruction_anywhere_changes_nothing(
    timed: Make, monkeypatch: pytest.MonkeyPatch, case: str, every: int
) -> None:
    """Neither registers nor refusals: a noisy line is no missing register, and no lost mark of a turn.

    Two servos get the same instructions one after the other: every odd one is each kind at one of them.
    """

    def life(disturbed: int) -> tuple[list[Any], int]:
        made = [Servo(1, position_ticks=100.0), Servo(2, position_ticks=200.0)]
        for servo in made:
            servo.put(reg.STARTUP, 1)
            if case == "count_reset":  # by another program: the address is left of its two marks
                servo.put(reg.OPERATING_MODE, 4)
                servo.put(next(each for each in servo.table if each.name == "indirect address 20"), 146)
        r = timed(2, made=made)
        try:
            return outcome(r, disturbed, monkeypatch)
        finally:
            r.emulator.stop()

    undisturbed, instructions = life(0)
    assert ("reset its count" in undisturbed[1][0]) is (case == "count_reset")
    assert instructions > 50
    different = [k for k in range(1, instructions + 1, every) if life(k)[0] != undisturbed]
    assert different == []


def test_no_read_of_a_mark_or_register_is_as_long_as_one_that_separates_requests() -> None:
    used = {identity._SIZE, *(register.size for register in reg.TABLE)}
    assert used.isdisjoint(BARRIER_SIZES)
