"""Transmissions: round trip, monotony, golden rows of the coupling."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.control.tick.transmission import RobotTransmission
from contid.robot_file.base import AxisDescription, Quantity
from contid.robot_file.rates import Rates
from contid.robot_file.robot import RobotDescription

TABLE = ((0.0, 0.1), (4.0, 0.35), (11.0, 0.6), (12.0, 1.4), (30.0, 1.5))


class Robot(RobotDescription):
    """A robot of any size, with its coupling given directly."""

    quantity: ClassVar[Quantity] = Quantity.LENGTH
    dimension: ClassVar[int] = 3
    model: str = "any"
    names: tuple[str, ...]
    box_mm: tuple[float, float] = (50.0, 650.0)
    extras: tuple[str, ...] = ()
    matrix: tuple[tuple[float, ...], ...] | None = None

    @property
    def axis_names(self):
        return self.names

    @property
    def extra_axis_names(self):
        return self.extras

    @property
    def lower(self):
        return (self.box_mm[0] / 1e3,) * len(self.names)

    @property
    def upper(self):
        return (self.box_mm[1] / 1e3,) * len(self.names)

    @property
    def coupling(self):
        return self.matrix


class PressureRobot(Robot):
    quantity: ClassVar[Quantity] = Quantity.PRESSURE


def robot(axes, kind=Robot, **keys):
    described = {name: AxisDescription(bus="b", **axis) for name, axis in axes.items()}
    names = tuple(name for name in axes if name not in keys.get("extras", ()))
    return kind(names=names, axes=described, rates=Rates(), **keys)


def block(a, b, c, d):
    """[[a I, b I], [c I, d I]] with 3x3 identities."""
    unit = [[float(i == j) for j in range(3)] for i in range(3)]
    top = [(*(a * x for x in row), *(b * x for x in row)) for row in unit]
    low = [(*(c * x for x in row), *(d * x for x in row)) for row in unit]
    return (*top, *low)


BASE_FIXED, TIP_FIXED, PRINTED = block(1, 0, 1, 1), block(1, 1, 0, 1), block(1, -1, 0, 1)
SIX = {f"s{s}.l{i}": {"mm_per_rev": 1e3 * 2 * math.pi} for s in (1, 2) for i in (1, 2, 3)}  # 1 rad per m


@pytest.mark.parametrize(
    ("matrix", "motors_mm"),
    [
        (BASE_FIXED, (300, 280, 320, 550, 540, 560)),
        (TIP_FIXED, (550, 540, 560, 250, 260, 240)),
        (PRINTED, (50, 20, 80, 250, 260, 240)),
    ],
)
def test_coupling_golden_rows(matrix, motors_mm):
    lengths = (0.300, 0.280, 0.320, 0.250, 0.260, 0.240)
    transmission = RobotTransmission(robot(SIX, matrix=matrix))
    assert transmission.to_device(lengths) == pytest.approx([m / 1e3 for m in motors_mm], abs=1e-15)
    back = transmission.to_actuation([m / 1e3 for m in motors_mm])
    assert back == pytest.approx(lengths, abs=1e-15)


def test_printed_coupling_gives_impossible_strokes():
    printed = RobotTransmission(robot(SIX, matrix=PRINTED))
    assert printed.to_device((0.2, 0.2, 0.2, 0.4, 0.34, 0.37))[:3] == pytest.approx((-0.2, -0.14, -0.17))


def test_pinion_by_hand():
    one = RobotTransmission(robot({"a": {"mm_per_rev": 37.699, "zero_deg": 90.0, "direction": -1}}))
    (angle,) = one.to_device((37.699e-3,))
    assert angle == pytest.approx(math.pi / 2 - 2 * math.pi, rel=1e-14)
    low, high = one.travel()[0]
    assert (low, high) == pytest.approx((one.to_device((0.65,))[0], one.to_device((0.05,))[0]))
    assert low < high


@given(
    lengths=st.tuples(*[st.floats(0.05, 0.65)] * 6),
    mm_per_rev=st.floats(5.0, 500.0),
    zero_deg=st.floats(-720, 720),
    direction=st.sampled_from([1, -1]),
    matrix=st.sampled_from([None, BASE_FIXED, TIP_FIXED, PRINTED]),
)
def test_round_trip_and_travel(lengths, mm_per_rev, zero_deg, direction, matrix):
    axis = {"mm_per_rev": mm_per_rev, "zero_deg": zero_deg, "direction": direction}
    transmission = RobotTransmission(robot(dict.fromkeys(SIX, axis), matrix=matrix))
    device = transmission.to_device(lengths)
    assert transmission.to_actuation(device) == pytest.approx(lengths, abs=1e-12)
    for value, (low, high) in zip(device, transmission.travel(), strict=True):
        assert low - 1e-9 <= value <= high + 1e-9


@given(a=st.floats(0.05, 0.65), b=st.floats(0.05, 0.65), direction=st.sampled_from([1, -1]))
def test_direction_is_the_sign_of_the_slope(a, b, direction):
    one = RobotTransmission(robot({"a": {"mm_per_rev": 40.0, "direction": direction}}))
    (at_a,), (at_b,) = one.to_device((a,)), one.to_device((b,))
    assert (at_b - at_a) * direction * (b - a) >= 0.0


@given(length_mm=st.floats(0.0, 30.0), falling=st.booleans())
def test_table_round_trip(length_mm, falling):
    rows = tuple((x, 2.0 - y) if falling else (x, y) for x, y in TABLE)
    table = RobotTransmission(robot({"a": {"mm_to_bar": rows}}, box_mm=(0.0, 30.0)))
    length = length_mm / 1e3
    device = table.to_device((length,))
    back = table.to_actuation(device)
    assert table.to_device(back) == pytest.approx(device, abs=1e-10)
    # The curve ends with slope 0: there one bit of pressure is up to a nanometre.
    assert back == pytest.approx((length,), abs=1e-12 if length < 0.029 else 2e-9)
    assert table.travel()[0] == pytest.approx((0.5e5, 1.9e5) if falling else (0.1e5, 1.5e5))


def test_pressures_pass_unchanged_bit_for_bit():
    axes: dict[str, dict[str, Any]] = {"p1": {}, "p2": {}}
    transmission = RobotTransmission(robot(axes, PressureRobot, box_mm=(0.0, 1.5e8)))
    pressures = (0.1 * 1e5, 1.2345678901234e5)
    assert transmission.to_device(pressures) == pressures
    assert transmission.to_actuation(pressures) == pressures


def test_extra_axes_have_maps_of_their_own():
    axes = {"a": {"mm_per_rev": 40.0}, "wrist": {"direction": -1, "zero_deg": 180.0}}
    transmission = RobotTransmission(robot(axes, extras=("wrist",)))
    angle, wrist = transmission.to_device((0.1, 0.5))
    assert wrist == pytest.approx(math.pi - 0.5)
    assert transmission.to_actuation((angle, wrist)) == pytest.approx((0.1, 0.5))
    assert transmission.axis_names == ("a", "wrist")


def test_the_coupling_leaves_extra_axes_alone():
    axes = SIX | {"grip": {}}
    transmission = RobotTransmission(robot(axes, extras=("grip",), matrix=BASE_FIXED))
    lengths = (0.3, 0.28, 0.32, 0.25, 0.26, 0.24, 0.007)
    device = transmission.to_device(lengths)
    assert device == pytest.approx((0.3, 0.28, 0.32, 0.55, 0.54, 0.56, 0.007))
    assert transmission.to_actuation(device) == pytest.approx(lengths)
