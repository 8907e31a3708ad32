"""Options of a servo that end at what its registers take (e-manual of the XL330, Control Table)."""

from __future__ import annotations

import re

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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"goal_current_ma": 301}, "goal_current_ma 301 is above current_limit_ma 300"),
        (
            {"homing": {"method": "hard_stop", "direction": 1, "current_ma": 301}},
            "homing.current_ma 301 is above current_limit_ma 300",
        ),
        (
            {"homing": {"method": "tension", "direction": 1, "current_ma": 301}},
            "homing.current_ma 301 is above current_limit_ma 300",
        ),
    ],
)
def test_no_current_is_above_the_limit_of_the_axis(options: dict[str, object], message: str) -> None:
    """Registers 102 and 38: the servo refuses a Goal Current above its Current Limit."""
    axis = DynamixelAxisOptions.model_validate({"id": 1, "current_limit_ma": 301, **options})
    assert axis.current_limit_ma == 301
    with pytest.raises(ValidationError, match=re.escape(message)):
        DynamixelAxisOptions.model_validate({"id": 1, "current_limit_ma": 300, **options})


def test_a_taut_tendon_is_not_slack() -> None:
    """The watch would report each tendon that homing has just tensioned."""
    homing = {"method": "tension", "direction": 1, "current_ma": 80}
    DynamixelAxisOptions.model_validate({"id": 1, "homing": {**homing, "slack_ma": 79}})
    with pytest.raises(ValidationError, match="slack_ma 80 is not below the 80 mA of a taut tendon"):
        DynamixelAxisOptions.model_validate({"id": 1, "homing": {**homing, "slack_ma": 80}})
