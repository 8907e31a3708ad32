"""A board with other parts than a Due's: the driver takes them from its hello."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from contid.control.engine.cycle import RealClock
from contid.errors import DeviceError
from contid.hal import AxisOnBus
from contid_drivers.due.bus import DueBus
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from contid_drivers.due.wiring import Adc
from contid_emulate.due import DueEmulator

pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: 10 bits over 2.5 V: 1 bar reads 409 steps, where a Due reads 1241.
OTHER = Adc(1023, 2500.0)
AIR: dict[str, Any] = {
    "channel": "p1",
    "calibration": [[0, 0], [100, 3]],
    "readback": [[0, 0], [2400, 3]],
    "ceiling_bar": 1.6,
    "slew_bar_s": 20.0,
}


def axis(**options: Any) -> list[AxisOnBus]:
    return [AxisOnBus("arm.a", DueAxisOptions.model_validate(options))]


def opened(port: Path, role: Role, axes: Sequence[AxisOnBus]) -> DueBus:
    bus = DueBus("board", DueBusOptions(port=str(port), role=role, latency_ms=60.0), axes, RealClock())
    try:
        bus.open()
    except BaseException:
        bus.close()
        raise
    return bus


def test_pressures_are_read_with_the_scale_of_the_board(tmp_path: Path):
    port, axes = tmp_path / "board", axis(**AIR)
    given = DueBusOptions(port=str(port), role=Role.PRESSURE)
    with DueEmulator(given, axes, adc=OTHER) as board:
        bus = opened(port, Role.PRESSURE, axes)
        bus.exchange({})
        bus.enable(bus.axes)
        end = time.monotonic() + 1.0
        while time.monotonic() < end:
            sample = bus.exchange({"arm.a": 100_000.0})["arm.a"]
            time.sleep(0.01)
        true_pa = float(board.command("get 1").split()[2])
        bus.close()
    assert true_pa == pytest.approx(100_000, abs=500)
    assert sample.valid
    assert sample.value == pytest.approx(true_pa, abs=3e5 / 1023)


def test_a_voltage_beyond_the_input_is_refused(tmp_path: Path):
    port, axes = tmp_path / "board", axis(**{**AIR, "readback": [[0, 0], [3125, 3]]})
    with (
        DueEmulator(DueBusOptions(port=str(port), role=Role.PRESSURE), axes, adc=OTHER),
        pytest.raises(DeviceError, match=r"board: arm\.a.*3125 mV at the pin.*end at 2500 mV"),
    ):
        opened(port, Role.PRESSURE, axes)


@pytest.mark.parametrize(
    ("parts", "options", "message"),
    [
        (("--bridges", "9"), {"bridge": "in_in"}, "for in_in bridges, found one for pwm_in_in, dir_pwm"),
        (("--capabilities", "1"), {"stall_current_ma": 800.0}, "a current sensor on m2, found none"),
    ],
)
def test_parts_that_the_board_does_not_have_are_named(
    tmp_path: Path, parts: Sequence[str], options: dict[str, Any], message: str
):
    port, axes = tmp_path / "board", axis(channel="m2", **options)
    with (
        DueEmulator(DueBusOptions(port=str(port), role=Role.MOTOR), axes, parts=parts),
        pytest.raises(DeviceError, match=rf"board: arm\.a.*{message}"),
    ):
        opened(port, Role.MOTOR, axes)
