"""Options of a servo that end at what its registers take (e-manual of the XL330, Control Table)."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from contid_drivers.dynamixel.options import DynamixelAxisOptions


@pytest.mark.parametrize(
    ("name", "least", "greatest"),
    [
        ("id", 0, 252),
        ("current_limit_ma", 1, 1750),
        ("goal_current_ma", 1, 1750),
        ("position_p", 0, 16383),
        ("position_i", 0, 16383),
        ("position_d", 0, 16383),
    ],
)
def test_a_number_ends_where_its_register_does(name: str, least: int, greatest: int) -> None:
    for value in (least, greatest):
        assert getattr(DynamixelAxisOptions.model_validate({"id": 1, name: value}), name) == value
    for value in (least - 1, greatest + 1):
        with pytest.raises(ValidationError, match=name):
            DynamixelAxisOptions.model_validate({"id": 1, name: value})
