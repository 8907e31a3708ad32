"""Boards whose analogue inputs have another full scale than a Due's."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from contid_drivers.due.codes import BoardState, Reason, Refusal
from contid_drivers.due.messages import Configured, Refused
from contid_drivers.due.wiring import Adc
from tests.firmware.conftest import VirtualBoard

pytestmark = pytest.mark.process

Make = Callable[..., VirtualBoard]
SCALES = [Adc(1023, 2500.0), Adc(4095, 3300.0), Adc(32767, 3000.0)]
READBACK = {"readback": [[0, 0], [2400, 3]], "wire_break_mv": 0}


@pytest.mark.parametrize("adc", SCALES, ids=str)
def test_a_pressure_is_the_same_on_every_scale(board: Make, adc: Adc) -> None:
    air = board("pressure", adc)
    assert isinstance(air.configure({"p0": READBACK}), Configured)
    air.arm(0)
    for _ in range(150):
        air.demand({0: 100_000})
        air.step(10)
    report = air.demand({0: 100_000}).channels[0]
    assert report.state is BoardState.ARMED
    assert report.position == pytest.approx(air.truth(0)[2], abs=300_000 / adc.steps + 10)
    assert air.truth(0)[2] == pytest.approx(100_000, abs=500)


@pytest.mark.parametrize("adc", SCALES, ids=str)
def test_a_reading_at_the_top_of_the_input_is_a_fault(board: Make, adc: Adc) -> None:
    air = board("pressure", adc)
    air.configure({"p0": READBACK})
    air.arm(0)
    air.command(f"input analog 0 {adc.steps}")
    air.step(30)
    assert air.demand().channels[0].reason is Reason.SENSOR_WIRE


@pytest.mark.parametrize("adc", SCALES, ids=str)
def test_a_current_is_the_same_on_every_scale(board: Make, adc: Adc) -> None:
    motors = board("motor", adc)
    motors.configure({"m0": {"current_ma_per_v": 1000.0}})
    motors.command(f"input analog 0 {round(adc.steps * 1000 / adc.mv)}")  # 1 V
    motors.step(5)
    assert motors.demand().channels[0].aux == pytest.approx(1000, abs=adc.mv / adc.steps + 2)


def test_a_configuration_for_another_scale_is_refused(board: Make) -> None:
    air = board("pressure", SCALES[0])
    air.adc = SCALES[2]
    answer = air.configure({"p0": READBACK})
    assert isinstance(answer, Refused)
    assert answer.refusal == Refusal.BAD_VALUE
