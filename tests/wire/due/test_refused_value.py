"""A value that the robot file allows and the board does not is named with its axis."""

from __future__ import annotations

from typing import Any

import pytest

from contid.control.engine.cycle import RealClock
from contid.errors import DeviceNotFoundError
from contid.hal import AxisOnBus
from contid_drivers.due.bus import DueBus
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from tests.wire.due.boards import AIR

pytestmark = [pytest.mark.process, pytest.mark.realtime]

CELL = {"floor_n": 1.0, "ceiling_n": 3.0, "stiffness_n_per_deg": 0.5, "readings": [[100, 0], [110, 30]]}
VALVES = {
    **{key: value for key, value in AIR.items() if key != "calibration"},
    "valves": {"outlet": "normally_open", "band_bar": 1e-9},
}


def axis(name: str, channel: str, **keys: Any) -> AxisOnBus:
    return AxisOnBus(name, DueAxisOptions.model_validate({"channel": channel, **keys}), None)


@pytest.mark.parametrize(
    ("role", "keys", "named"),
    [
        (Role.PRESSURE, AIR | {"slew_bar_s": 0.005}, "arm.b: slew 500 is beyond"),
        (Role.PRESSURE, VALVES, "arm.b: valves is beyond"),
        (Role.PRESSURE, AIR | {"calibration": [[0, 0], [10, 0.0001], [100, 3]]}, "arm.b: calibration is"),
        (Role.MOTOR, {"counts_per_rev": 1_000_000}, "arm.b: velocity 1305556 is beyond"),
        (Role.MOTOR, {"homing": {"direction": 1, "timeout_s": 1e-4}}, "arm.b: home_timeout_ms 0 is beyond"),
        (Role.MOTOR, {"tension": CELL, "start_state": "brake"}, "arm.b: raw_high 136 is beyond"),
    ],
)
def test_a_value_beyond_the_board_is_named_with_its_axis(world, role, keys, named) -> None:
    letter, good = ("m", {}) if role is Role.MOTOR else ("p", AIR)
    first = axis("arm.a", f"{letter}0", **good)
    _, emulator = world([first], role)
    options = DueBusOptions(port=str(emulator.port), role=role, latency_ms=60.0)
    bus = DueBus("board", options, [axis("arm.b", f"{letter}1", **keys), first], RealClock())
    with pytest.raises(DeviceNotFoundError, match=named):
        bus.open()
    bus.close()
