"""Tendons on emulated spools: the plant against the model, homing to a tension, slack and snapped."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from contid.control.tick.faults import Fault, of_device
from contid.errors import DeviceError
from contid.kinematics.tendon.geometry import TendonGeometry
from contid.kinematics.tendon.tension import TendonStatics
from contid_devices.dynamixel import TOOLS
from contid_drivers.dynamixel import registers as reg
from contid_emulate.dynamixel import Servo, TendonPlant
from tests.support.tendon_sections import even_section

pytestmark = pytest.mark.process

Make = Callable[..., Any]
MA_PER_N = 28.0
M_PER_TICK = 2 * np.pi * 0.010 / 4096
HOMING = {"method": "tension", "direction": 1, "current_ma": 120, "speed_deg_s": 180, "timeout_s": 40}
#: One section of `tendon3`.
STATICS = TendonStatics(TendonGeometry((even_section(0.1, 0.008),)), (0.02945,), np.full(3, 20e3), 1.0, 25.0)


def plant_on(servos: list[Servo], taut: list[float]) -> TendonPlant:
    stiffness = [20e3 * MA_PER_N * M_PER_TICK] * 3
    matrix = STATICS.geometry.pull_matrix / M_PER_TICK
    bending = [0.02945 * MA_PER_N / M_PER_TICK] * 2
    return TendonPlant(servos, (1,) * 3, taut, stiffness, matrix, bending)


def spools(seed: int = 1) -> list[Servo]:
    rng = random.Random(seed)
    made = [Servo(i + 1, position_ticks=round(rng.uniform(-600.0, -100.0))) for i in range(3)]
    for servo in made:
        servo.memory[9] = 0
    return made


def quiet(line: str) -> None:
    """Ignore the report."""


def home(r: Any) -> Any:
    return TOOLS.home("servos", r.options, r.axes, ("r.a1", "r.a2", "r.a3"), quiet)


def test_taut_tendons_have_the_tensions_of_the_model():
    servos = spools()
    pretension = STATICS.rest_n / 20e3 / M_PER_TICK  # wound beyond just taut
    plant = plant_on(servos, [0.0] * 3)
    for bends in np.random.default_rng(2).uniform(-1.0, 1.0, (20, 2)):
        pulls = STATICS.pulls(bends)
        for servo, position in zip(servos, pretension + pulls / M_PER_TICK, strict=True):
            servo.motion.position = float(position)
        np.testing.assert_allclose(plant.tensions_ma(), MA_PER_N * STATICS.tensions(pulls), rtol=1e-9)


def test_a_slack_tendon_does_not_push():
    servos = spools()
    plant = plant_on(servos, [0.0] * 3)
    for servo, position in zip(servos, (-500.0, 10.0, 10.0), strict=True):
        servo.motion.position = position
    tensions = plant.tensions_ma()
    assert tensions[0] == 0.0
    # Two tendons alone bend the section towards the point between them.
    assert tensions[1] == pytest.approx(tensions[2])
    assert 0.0 < tensions[1] < 10 * 20e3 * MA_PER_N * M_PER_TICK


@pytest.mark.realtime
def test_homing_in_a_jig_gives_all_tendons_the_same_tension(rig: Make) -> None:
    servos = spools()
    taut = np.array([40.0, -25.0, 60.0])
    stiffness = 20e3 * MA_PER_N * M_PER_TICK
    plant = TendonPlant(servos, (1,) * 3, taut.tolist(), [stiffness] * 3)
    r = rig(3, axis={"homing": HOMING}, made=servos)
    found = home(r)
    assert not any(servo.torque for servo in servos)
    # 120 mA less the friction of the emulated gear.
    np.testing.assert_allclose(plant.tensions_ma(), 80.0, atol=2.0 * stiffness)
    zeros = np.array([each.value for each in found]) / reg.RAD_PER_TICK
    # Powered up a turn below zero, where the count begins anew.
    # A look that a busy machine delays is a count or two late.
    np.testing.assert_allclose(zeros - reg.TICKS_PER_REV, taut + 80.0 / stiffness, atol=3.0)
    assert [each.at_mm for each in found] == [0.0] * 3
    assert "tension with 120 mA" in found[0].how


@pytest.mark.realtime
def test_a_snapped_tendon_is_named_and_torque_is_off(rig: Make) -> None:
    servos = spools()
    plant_on(servos, [0.0] * 3).snap(1)
    r = rig(3, axis={"homing": {**HOMING, "slack_deg": 120}}, made=servos)
    with pytest.raises(DeviceError, match=r"servo 2 .*slack or snapped tendon"):
        home(r)
    assert not any(servo.torque for servo in servos)


@pytest.mark.process
@pytest.mark.realtime
def test_axes_are_refused_until_they_were_tensioned_since_power_up(rig: Make) -> None:
    servos = spools()
    plant_on(servos, [0.0] * 3)
    r = rig(3, axis={"homing": HOMING}, made=servos)
    r.bus.open()
    assert "not homed" in r.tick()["r.a1"].fault
    r.bus.close()
    home(r)
    r.bus.open()
    r.bus.clear_fault(["r.a1", "r.a2", "r.a3"])
    r.bus.enable(["r.a1", "r.a2", "r.a3"])
    assert not r.tick()["r.a1"].fault


def running(rig: Make, **homing: Any) -> tuple[Any, TendonPlant]:
    """Three spools in a jig, homed and under torque; the tendons hold about 80 mA."""
    servos = spools()
    plant = TendonPlant(servos, (1,) * 3, (0.0,) * 3, (20e3 * MA_PER_N * M_PER_TICK,) * 3)
    r = rig(3, axis={"homing": {**HOMING, **homing}}, made=servos)
    home(r)
    r.bus.open()
    names = ["r.a1", "r.a2", "r.a3"]
    r.bus.clear_fault(names)
    r.bus.enable(names)
    return r, plant


@pytest.mark.process
@pytest.mark.realtime
def test_a_tendon_that_snaps_while_the_robot_runs_is_a_fault_of_its_axis(rig: Make) -> None:
    r, plant = running(rig, slack_ma=20, slack_ms=100)
    samples = r.tick(30)
    assert not any(sample.fault for sample in samples.values())
    assert samples["r.a2"].effort == pytest.approx(0.08, abs=0.02)
    plant.snap(1)
    r.until(lambda: bool(r.tick()["r.a2"].fault))
    samples = r.tick()
    assert "snapped tendon: " in samples["r.a2"].fault
    assert of_device(samples["r.a2"].fault) is Fault.TENDON_SNAPPED
    assert not samples["r.a1"].fault
    assert not samples["r.a3"].fault


@pytest.mark.process
@pytest.mark.realtime
def test_a_tendon_that_was_paid_out_too_far_is_slack(rig: Make) -> None:
    r, _ = running(rig, slack_ma=20, slack_ms=100)
    here = r.tick()["r.a1"].value
    goal = here
    for _ in range(200):
        goal -= 0.002
        r.tick(a1=goal)
        if r.tick()["r.a1"].fault:
            break
    r.until(lambda: bool(r.tick()["r.a1"].fault))
    fault = of_device(r.tick()["r.a1"].fault)
    assert fault in (Fault.TENDON_SLACK, Fault.TENDON_SNAPPED)


@pytest.mark.process
@pytest.mark.realtime
def test_tendons_are_not_watched_unless_asked_for(rig: Make) -> None:
    r, plant = running(rig)
    plant.snap(1)
    for _ in range(60):
        assert not r.tick()["r.a2"].fault
