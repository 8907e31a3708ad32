"""Before a servo is armed its position must be inside its travel; torque off reaches all servos of a bus."""

from __future__ import annotations

import math
from typing import cast

import pytest

from contid.errors import DeviceError
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.arming import TRAVEL_SLACK_RAD, require_inside_travel, settings, torque_off
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.client import NoAnswerError, ServoClient
from contid_drivers.dynamixel.models import BY_NAME
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions
from contid_drivers.dynamixel.port import ServoPort
from contid_drivers.dynamixel.registers import Register

TRAVEL = (math.radians(90.0), math.radians(180.0))
CLIENT = ServoClient("servos", cast(ServoPort, None), {1: "finger.left"})


def axis(travel: tuple[float, float] | None = TRAVEL, device: int = 1, name: str = "finger.left") -> Axis:
    options = DynamixelAxisOptions.model_validate({"id": device})
    return Axis(name, options, travel, 4, device, BY_NAME[options.model])


@pytest.mark.parametrize(
    ("degrees", "refused"),
    [(60.0, True), (69.0, True), (71.0, False), (135.0, False), (199.0, False), (201.0, True), (500.0, True)],
)
def test_a_position_more_than_the_slack_outside_the_travel_is_refused(degrees: float, refused: bool) -> None:
    assert math.degrees(TRAVEL_SLACK_RAD) == pytest.approx(20.0)
    servo = axis()
    position = servo.to_ticks(math.radians(degrees))
    if not refused:
        require_inside_travel(CLIENT, servo, position)
        return
    with pytest.raises(
        DeviceError, match=rf"finger\.left.* stands at {degrees:.0f}\.\d deg, .*90\.0\.\.180\.0 deg"
    ):
        require_inside_travel(CLIENT, servo, position)


def test_without_a_travel_every_position_is_accepted() -> None:
    require_inside_travel(CLIENT, axis(None), 1 << 20)


@pytest.mark.parametrize(
    ("deg_s", "units"), [(0.0, 0), (0.1, 1), (0.6, 1), (1.374, 1), (2.1, 2), (137.4, 100)]
)
def test_a_slow_profile_is_never_written_as_no_limit(deg_s: float, units: int) -> None:
    """Registers 112 and 108: 0 is an infinite velocity and acceleration (e-manual of the XL330)."""
    options = DynamixelAxisOptions(
        id=1, profile_velocity_deg_s=deg_s, profile_acceleration_deg_s2=deg_s * 21.4577 / 1.374
    )
    servo = Axis("finger.left", options, TRAVEL, 4, 1, BY_NAME[options.model])
    written = dict(settings(servo, DynamixelBusOptions(port="/dev/ttyUSB0")))
    assert (written[reg.PROFILE_VELOCITY], written[reg.PROFILE_ACCELERATION]) == (units, units)


class QuietPort:
    """A port whose servos take every packet."""

    def flush(self) -> None:
        """Nothing to drop."""

    def send(self, packet: bytes) -> float:
        """Taken at once."""
        return 0.0


class OneDeafServo(ServoClient):
    """Torque reads as off everywhere; writes to servo 1 have no answer, and servo 3 never answers."""

    def __init__(self) -> None:
        super().__init__("servos", cast(ServoPort, QuietPort()))
        self.written: list[int] = []

    def read_block(self, device: int, address: int, size: int, tries: int = 3) -> bytes:
        """Torque is off."""
        if device == 3:
            raise NoAnswerError(self.name(device), "no answer")
        return b"\0"

    def write(self, device: int, register: Register, value: int) -> None:
        """Taken by all but the first."""
        if device == 1:
            raise NoAnswerError(self.name(device), "no answer")
        self.written.append(device)


def test_a_servo_that_does_not_answer_leaves_none_behind_as_enabled() -> None:
    """Torque is off in all: none may count as enabled, and the one that did not confirm is named."""
    axes = [axis(None, device, f"finger.{device}") for device in (1, 2, 3)]
    for each in axes:
        each.arm(5)
    client = OneDeafServo()
    assert torque_off(client, axes) == ["finger.3"]
    assert [(each.enabled, each.watchdog_units) for each in axes] == [(False, 0)] * 3
    assert client.written == [2]
