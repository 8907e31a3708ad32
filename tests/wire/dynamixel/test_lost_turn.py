"""A reset or another program in any state and register layout: no servo is armed in a wrong turn."""

from __future__ import annotations

import os
import random
import time
from collections.abc import Callable
from typing import Any

import pytest

from contid.errors import DeviceError
from contid.hal import Rest
from contid_drivers.dynamixel import registers as reg
from contid_emulate.dynamixel import Servo

pytestmark = pytest.mark.realtime

TICK = reg.RAD_PER_TICK
Make = Callable[..., Any]
RESETS = int(os.environ.get("CONTID_RESETS", "6"))
FAR = 3 * 4096 + 700
LAYOUTS = ("indirect", "mixed", "refusing")


def robot(rig: Make, monkeypatch: pytest.MonkeyPatch, layout: str) -> Any:
    """Two servos, read through indirect addresses or by the plain block, three turns up, off."""
    made = [
        Servo(i + 1, firmware=53 if layout == "mixed" and i else 52, position_ticks=FAR) for i in range(2)
    ]
    for servo in made:
        servo.memory[9] = servo.forgotten_ticks = 0  # it came here without a loss of power
    if layout == "refusing":
        refuses = Servo._refuses

        def without(servo: Servo, register: reg.Register, value: int) -> Any:
            return 7 if register.address >= reg.INDIRECT_ADDRESS else refuses(servo, register, value)

        monkeypatch.setattr(Servo, "_refuses", without)
    r = rig(2, made=made, retry_ms=0)
    r.bus.open()
    assert r.bus._link.indirect is (layout == "indirect")
    r.bus.enable(["r.a1", "r.a2"])
    r.bus.disable(["r.a1", "r.a2"], Rest.RELAX)
    r.tick(3)
    return r


def true_rad(r: Any, device: int) -> float:
    return float(r.emulator.servo(device).position_ticks * TICK)


def require_right_turns(r: Any) -> bool:
    """Enable, after clear-fault where needed; whether both follow, which they do in their true turn."""
    for order in (r.bus.enable, r.bus.clear_fault, r.bus.enable):
        try:
            order(["r.a1", "r.a2"])
        except DeviceError:
            continue
        if order == r.bus.enable:
            samples = [r.tick()[f"r.a{device}"] for _ in range(5) for device in (1, 2)]
            for sample, device in zip(samples, (1, 2) * 5, strict=True):
                if sample.valid:
                    assert sample.value == pytest.approx(true_rad(r, device), abs=0.1)
            if all(sample.valid and not sample.fault for sample in samples):
                return True
    return False


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("watched", [True, False], ids=["exchanging", "silent"])
def test_the_supply_of_servos_that_are_off_is_interrupted(
    rig: Make, monkeypatch: pytest.MonkeyPatch, layout: str, watched: bool
) -> None:
    r = robot(rig, monkeypatch, layout)
    r.emulator.set("brownout")
    for _ in range(40):
        samples = r.tick() if watched else {}
        time.sleep(0.01)
    if watched:
        assert "reset itself" in samples["r.a1"].fault
        assert not samples["r.a1"].valid
    with pytest.raises(DeviceError, match="reset itself"):
        r.bus.enable(["r.a1", "r.a2"])
    assert not any(servo.torque for servo in r.emulator.servos)
    assert require_right_turns(r)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_reset_between_open_and_the_first_exchange(
    rig: Make, monkeypatch: pytest.MonkeyPatch, layout: str
) -> None:
    r = robot(rig, monkeypatch, layout)
    r.as_another_process()
    r.bus.open()
    r.emulator.set("brownout", 1)
    time.sleep(0.3)
    with pytest.raises(DeviceError, match="reset itself"):
        r.bus.enable(["r.a1", "r.a2"])
    assert "reset itself" in r.tick()["r.a1"].fault


@pytest.mark.parametrize("layout", LAYOUTS)
def test_servos_that_kept_their_turn_are_armed_again(
    rig: Make, monkeypatch: pytest.MonkeyPatch, layout: str
) -> None:
    r = robot(rig, monkeypatch, layout)
    time.sleep(0.3)
    for _ in range(3):
        assert not any(sample.fault for sample in r.tick().values())
        time.sleep(0.2)
    r.bus.enable(["r.a1", "r.a2"])
    r.as_another_process()
    r.bus.open()
    assert not any(sample.fault for sample in r.tick().values())
    r.bus.enable(["r.a1", "r.a2"])
    assert r.tick()["r.a1"].value == pytest.approx(true_rad(r, 1), abs=0.1)


@pytest.mark.parametrize("seed", range(RESETS))
def test_random_resets(rig: Make, monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    rng = random.Random(seed)
    r = robot(rig, monkeypatch, LAYOUTS[seed % 3])
    state = rng.choice(("off", "held", "armed", "reopened"))
    if state in ("held", "armed"):
        r.bus.enable(["r.a1", "r.a2"])
        r.tick(3)
    if state == "held":
        r.bus.disable(["r.a1", "r.a2"], Rest.HOLD)
    if state == "reopened":
        r.as_another_process()
        r.bus.open()
    exchanges = rng.random() < 0.7
    for _ in range(rng.choice((1, 1, 2))):
        what = rng.choice(("brownout", "brownout", "mode", "both"))
        if what != "mode":
            r.emulator.set("brownout", rng.choice((None, 1, 2)))
        if what != "brownout":  # another program on a second adapter
            servo = r.emulator.servo(rng.choice((1, 2)))
            servo.put(reg.TORQUE_ENABLE, 0)
            for mode in (3, 4):
                servo.write(reg.OPERATING_MODE.address, bytes((mode,)))
        until = time.monotonic() + rng.uniform(0.0, 0.5)
        while time.monotonic() < until:
            if exchanges:
                r.tick()
            time.sleep(0.005)
    require_right_turns(r)
