"""Units at the ends of names, in brackets, and symbols whose case matters."""

from __future__ import annotations

import pytest

from contid_adapt.meaning.units import factor_to, name_and_unit, unit_of_name, unit_word


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("x_min", ""),
        ("p1.pressure_min", ""),
        ("t_min", "min"),
        ("elapsed_time_min", "min"),
        ("x_minutes", "min"),
        ("plug_in", ""),
        ("count_n", ""),
        ("length_inches", ""),
        ("p.m", ""),
        ("stamp.nsecs", "ns"),
        ("secs", "s"),
        ("f_MN", "meganewton"),
    ],
)
def test_the_end_of_a_name_is_a_unit_only_where_it_can_be_no_other_word(name: str, unit: str) -> None:
    assert unit_of_name(name) == unit


@pytest.mark.parametrize(
    ("symbol", "required", "factor"),
    [
        ("mN", "n", 1e-3),
        ("mn", "n", 1e-3),
        ("MN", "n", 1e6),
        ("MPa", "bar", 10.0),
        ("mpa", "bar", 10.0),
        ("mPa", "bar", 1e-8),
    ],
)
def test_the_case_decides_between_milli_and_mega(symbol: str, required: str, factor: float) -> None:
    assert factor_to(unit_word(symbol), required) == pytest.approx(factor)


def test_empty_brackets_are_no_unit() -> None:
    assert name_and_unit("q_RS_w []") == ("q_RS_w", "")
    assert name_and_unit("gain [x]") == ("gain [x]", "")
