"""The Feetech driver under the contract of contid, and its emulator under the vendor's SDK.

Here, or in a checkout of your own: ``pip install .[test]``, then ``pytest``.
"""

from __future__ import annotations

import math
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from contid.errors import DeviceError, DeviceNotFoundError
from contid.hal import AxisOnBus
from contid_driverkit.contract import DriverContract
from contid_feetech import DRIVER, FeetechAxisOptions, FeetechOptions
from contid_feetech.emulator import FeetechEmulator, Servo
from feetech_rig import IDS, FeetechRig, bus_at, feetech


class TestSts(DriverContract):
    def make(self) -> AbstractContextManager[FeetechRig]:
        return feetech("sts")


class TestScs(DriverContract):
    def make(self) -> AbstractContextManager[FeetechRig]:
        return feetech("scs")


class TestEchoingAdapter(DriverContract):
    def make(self) -> AbstractContextManager[FeetechRig]:
        return feetech("sts", echo=True)


def test_a_reset_servo_is_a_fault_and_does_not_move_again() -> None:
    with feetech() as rig:
        rig.bus.open()
        rig.bus.enable(rig.bus.axes)
        rig.emulator.servos[7].memory[40] = 0
        assert "torque lost" in rig.pump(0.05)["left.b"].fault
        rig.pump(0.2, {"left.b": rig.value("left.b") + 0.2})
        assert not rig.powered("left.b")
        rig.bus.close()


@pytest.mark.parametrize(
    ("register", "value", "message"),
    [(3, 5, "of series scs"), (33, 1, "does not control its position"), (12, 1, "moves from step 0 to 511")],
)
def test_a_servo_that_would_not_do_as_commanded_is_refused_at_opening(
    tmp_path: Path, register: int, value: int, message: str
) -> None:
    servo = Servo(3, "sts", 100.0)
    servo.memory[register] = value
    axis = AxisOnBus("arm.a", FeetechAxisOptions(id=3), travel=(0.0, math.pi))
    emulator = FeetechEmulator(str(tmp_path / "servos"), [servo])
    with emulator, pytest.raises(DeviceNotFoundError, match=message):
        bus_at(tmp_path / "servos", "sts", [axis]).open()


@pytest.mark.parametrize("jammed", [False, True])
def test_an_end_stop_is_found_by_its_current(tmp_path: Path, jammed: bool) -> None:
    servo = Servo(3, "sts", 700.0)
    servo.stops, servo.jammed = (300.0, 1e9), jammed
    keys = {"direction": -1, "effort": 0.3, "speed_deg_s": 90, "backoff_deg": 4}
    options = FeetechAxisOptions.model_validate({"id": 3, "speed_deg_s": 90, "homing": keys})
    axis = AxisOnBus("arm.a", options, travel=(0.0, math.pi))
    with FeetechEmulator(str(tmp_path / "servos"), [servo]):
        bus = FeetechOptions(port=str(tmp_path / "servos"), latency_ms=60.0)
        if jammed:
            with pytest.raises(DeviceError, match="stands still"):
                DRIVER.home("servos", bus, [axis], ["arm.a"], print)  # type: ignore[attr-defined]
        else:
            (found,) = DRIVER.home("servos", bus, [axis], ["arm.a"], print)  # type: ignore[attr-defined]
            assert found.value == pytest.approx(300.0 / 4096 * math.tau, abs=math.radians(0.5))
        assert not servo.memory[40]


def test_several_turns_are_negative_and_beyond_4095(tmp_path: Path) -> None:
    servo = Servo(3, "sts", -100.0)
    servo.put(11, 0)  # limits 0 and 0
    axis = AxisOnBus("arm.a", FeetechAxisOptions(id=3), travel=(-math.tau, 3 * math.tau))
    with FeetechEmulator(str(tmp_path / "servos"), [servo]):
        bus = bus_at(tmp_path / "servos", "sts", [axis])
        bus.open()
        assert bus.exchange({})["arm.a"].value == pytest.approx(-100.0 / 4096 * math.tau)
        bus.enable(["arm.a"])
        bus.exchange({"arm.a": -1.0})
        assert servo.get(42) == round(-1.0 / math.tau * 4096)
        bus.close()


@pytest.mark.parametrize("series", ["sts", "scs"])
def test_the_sdk_of_the_vendor_and_the_driver_agree_about_a_servo(
    series: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Independent witness: ftservo-python-sdk reads and moves the emulated servo that the driver moves."""
    sdk = pytest.importorskip("scservo_sdk")
    monkeypatch.setattr("scservo_sdk.port_handler.LATENCY_TIMER", 500)  # a busy machine answers late [ms]
    with feetech(series) as rig:
        rig.bus.open()
        rig.bus.enable(rig.bus.axes)
        goals = {axis: rig.value(axis) + 0.2 for axis in rig.bus.axes}
        samples = rig.pump(0.4, goals)
        rig.bus.close()
        port = sdk.PortHandler(rig.emulator.port)
        assert port.openPort()
        handler = sdk.sms_sts(port) if series == "sts" else sdk.scscl(port)
        for axis, device in IDS.items():
            model, result, error = handler.ping(device)
            assert (model, result, error) == (777 if series == "sts" else 1284, 0, 0)
            position, result, _ = handler.ReadPos(device)
            assert result == 0
            assert position * rig.step == pytest.approx(samples[axis].value, abs=1.5 * rig.step)
        if series == "sts":
            assert handler.WritePosEx(1, 900, 400, 50) == (0, 0)
        else:
            assert handler.WritePos(1, 300, 0, 400) == (0, 0)
        rig.wait(1.5)
        assert handler.ReadPos(1)[0] == (900 if series == "sts" else 300)
        assert handler.ReadMoving(1)[0] == 0
        port.closePort()
        rig.bus.open()
        assert rig.pump(0.0)["left.a"].value == pytest.approx((900 if series == "sts" else 300) * rig.step)


@pytest.mark.parametrize("series", ["sts", "scs"])
def test_the_driver_sends_the_bytes_of_the_sdk(series: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The packets of a goal for two servos and of a read, as the SDK makes them."""
    sdk = pytest.importorskip("scservo_sdk")
    written: list[bytes] = []

    def note(wire: list[int]) -> int:
        written.append(bytes(wire))
        return len(wire)

    recorder = sdk.PortHandler("none")
    monkeypatch.setattr(recorder, "clearPort", lambda: None)
    monkeypatch.setattr(recorder, "writePort", note)
    with feetech(series) as rig:
        rig.bus.open()
        sent: list[bytes] = []
        send = rig.bus.line.send

        def record(wire: bytes) -> float:
            sent.append(wire)
            return send(wire)

        monkeypatch.setattr(rig.bus.line, "send", record)
        rig.bus.send({"left.a": 300 * rig.step, "left.b": 20 * rig.step})
        rig.bus.power(["left.a"], True)
        rig.bus.read()
        rig.bus.close()
    handler = sdk.sms_sts(recorder) if series == "sts" else sdk.scscl(recorder)
    speed = round(math.radians(60.0) / rig.step)
    for device, goal in ((1, 300), (7, 20)):
        if series == "sts":
            handler.SyncWritePosEx(device, goal, speed, 0)
        else:
            handler.SyncWritePos(device, goal, 0, speed)
    handler.groupSyncWrite.txPacket()
    torque = sdk.GroupSyncWrite(handler, 40, 1)
    torque.addParam(1, [1])
    torque.txPacket()
    if series == "sts":
        reading = sdk.GroupSyncRead(handler, 40, 31)
        for device in IDS.values():
            reading.addParam(device)
        reading.txPacket()
    else:
        for device in IDS.values():
            handler.portHandler.is_using = False
            handler.readTx(device, 40, 31)
    assert sent == written
