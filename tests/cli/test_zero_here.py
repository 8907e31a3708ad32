"""``contid home --here``: the looks that a zero set by hand has to pass; ``contid servo ROBOT``."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pytest

from contid.errors import ContidError, DeviceError
from contid.hal import DeviceKind, Sample
from contid.hal.homing import UNKNOWN, Reference
from contid_devices.homing.zero_here import here, require_place
from contid_devices.live_axes import table

AXIS = "finger.left"


class Shaft:
    """A shaft that a person turns: its angles [deg] at each look."""

    def __init__(self, *angles_deg: float, fault: str = "") -> None:
        self.angles_deg, self.look, self.fault = angles_deg, 0, fault
        self.asked: list[str] = []

    def read(self) -> Mapping[str, Sample]:
        value = math.radians(self.angles_deg[self.look])
        return {AXIS: Sample(value, 0.0, not self.fault, 0.0, fault=self.fault)}

    def ask(self, request: str) -> None:
        self.asked.append(request)
        self.look += 1

    def found(self, reference: Reference = UNKNOWN) -> float:
        return math.degrees(here(AXIS, reference, self.read, self.ask))


def test_the_second_look_is_the_zero() -> None:
    shaft = Shaft(100.0, 112.0, 100.4)
    assert shaft.found() == pytest.approx(100.4)
    assert ["away" in shaft.asked[0], "back" in shaft.asked[1]] == [True, True]


@pytest.mark.parametrize(
    ("shaft", "zero_deg", "message"),
    [
        (Shaft(100.0, 100.2, 100.0), None, "moved by 0.20 deg"),
        (Shaft(100.0, 112.0, 103.0), None, "stood still at two places"),
        (Shaft(100.0, 112.0, 100.0), 90.0, "its zero moved by 10.00 deg"),
        (Shaft(100.0, 112.0, 100.0, fault="overload"), None, "overload"),
    ],
)
def test_a_zero_that_does_not_repeat_is_refused(shaft: Shaft, zero_deg: float | None, message: str) -> None:
    zero_rad = None if zero_deg is None else math.radians(zero_deg)
    with pytest.raises(DeviceError, match=message):
        shaft.found(Reference(zero_rad))


def test_axes_that_find_their_zero_and_lengths_of_angles_are_refused() -> None:
    require_place(60.0, None, AXIS, 30.0)
    with pytest.raises(ContidError, match="leave out --here"):
        require_place(60.0, object(), AXIS, 30.0)
    with pytest.raises(ContidError, match="leave out --at-mm"):
        require_place(None, None, AXIS, 30.0)


def test_values_have_the_units_of_their_device() -> None:
    servo = Sample(math.pi, 0.0, True, 0.0, effort=0.12, temperature_c=31.0, voltage_v=11.9)
    chamber = Sample(1e5, 0.0, False, 0.0, effort=0.25)
    kinds = {"a": DeviceKind.SERVO, "b": DeviceKind.REGULATOR}
    cells = [list(column.cells) for column in table({"a": servo, "b": chamber}, kinds).columns]
    assert [column[0] for column in cells] == ["a", "180.00 deg", "120 mA", "11.9 V", "31 C", ""]
    assert [column[1] for column in cells] == ["b", "1.00 bar", "25 % duty", "-", "-", "silent"]
