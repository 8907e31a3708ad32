"""Whether a servo's position is plausible before it is armed: on both sides of its travel."""

from __future__ import annotations

import math
from typing import cast

import pytest

from contid.errors import DeviceError
from contid_drivers.dynamixel.arming import TRAVEL_SLACK_RAD, plausible
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.client import ServoClient
from contid_drivers.dynamixel.models import BY_NAME
from contid_drivers.dynamixel.options import DynamixelAxisOptions
from contid_drivers.dynamixel.port import ServoPort

TRAVEL = (math.radians(90.0), math.radians(180.0))
CLIENT = ServoClient("servos", cast(ServoPort, None), {1: "finger.left"})


def axis(travel: tuple[float, float] | None = TRAVEL) -> Axis:
    options = DynamixelAxisOptions.model_validate({"id": 1})
    return Axis("finger.left", options, travel, 4, 1, BY_NAME[options.model])


@pytest.mark.parametrize(
    ("degrees", "refused"),
    [(60.0, True), (69.0, True), (71.0, False), (135.0, False), (199.0, False), (201.0, True), (500.0, True)],
)
def test_a_position_more_than_the_slack_outside_the_travel_is_refused(degrees: float, refused: bool) -> None:
    assert math.degrees(TRAVEL_SLACK_RAD) == pytest.approx(20.0)
    servo = axis()
    position = servo.to_ticks(math.radians(degrees))
    if not refused:
        plausible(CLIENT, servo, position)
        return
    with pytest.raises(
        DeviceError, match=rf"finger\.left.* stands at {degrees:.0f}\.\d deg, .*90\.0\.\.180\.0 deg"
    ):
        plausible(CLIENT, servo, position)


def test_without_a_travel_every_position_is_plausible() -> None:
    plausible(CLIENT, axis(None), 1 << 20)
