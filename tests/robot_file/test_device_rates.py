"""Robot files with rates or limits beyond what their devices do are refused, at the key of the device."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from contid.errors import BadInputError
from contid.robot_file.load import parse_robot_file


def refusals(text: str) -> list[str]:
    with pytest.raises(BadInputError) as refused:
        parse_robot_file(text, "robot.yaml")
    return str(refused.value).splitlines()


def test_a_motor_slower_than_its_rack(configs: Path) -> None:
    text = (configs / "trirack.emulated.yaml").read_text()
    needed = 100 / (math.pi * 25) * 360
    slow = text.replace("channel: m1,", f"channel: m1, velocity_deg_s: {needed - 0.1:.3f},")
    (message,) = refusals(slow)
    assert "velocity_deg_s is 458.3 deg/s, but rates.velocity_mm_s 100 needs 458.4" in message
    line = next(i for i, each in enumerate(slow.splitlines(), start=1) if "channel: m1" in each)
    assert message.startswith(f"robot.yaml:{line}:")
    assert parse_robot_file(
        text.replace("channel: m1,", f"channel: m1, velocity_deg_s: {needed + 0.1:.3f},"), ""
    )


def test_coupled_motors_turn_for_both_segments(configs: Path) -> None:
    text = (configs / "trirack2.emulated.yaml").read_text()
    slow = text.replace("bus: motors,", "bus: motors, velocity_deg_s: 300,")
    messages = refusals(slow)
    assert len(messages) == 3, "the second platform's"
    assert all("velocity_mm_s 50 needs 458.4" in message for message in messages)


def test_a_regulator_slower_than_the_pressure(configs: Path) -> None:
    text = (configs / "stiffflop1.emulated.yaml").read_text()
    (message,) = refusals(text.replace("channel: p2", "channel: p2\n        slew_bar_s: 1.5"))
    assert "slew_bar_s is 1.5 bar/s, but rates.velocity_bar_s 2 needs 2" in message


def test_a_recorded_file_is_read_as_it_was(configs: Path) -> None:
    text = (configs / "trirack.emulated.yaml").read_text()
    slow = text.replace("channel: m1,", "channel: m1, velocity_deg_s: 250,")
    assert parse_robot_file(slow, "robot.yaml", recorded=True).buses


@pytest.mark.parametrize(("velocity_mm_s", "refused"), [(64, False), (65, True), (250, True)])
def test_a_servo_slower_than_its_rack(configs: Path, velocity_mm_s: int, refused: bool) -> None:
    """The 103 rpm of an XL330-M288 are 64.7 mm/s of its rack."""
    text = (configs / "finger.yaml").read_text()
    fast = text.replace("velocity_mm_s: 60", f"velocity_mm_s: {velocity_mm_s}")
    if not refused:
        assert parse_robot_file(fast, "finger.yaml")
        return
    messages = refusals(fast)
    assert len(messages) == 2
    assert f"without load a xl330-m288 does 618 deg/s, but rates.velocity_mm_s {velocity_mm_s}" in messages[0]


def test_a_servo_of_an_extra_axis_and_its_profile(configs: Path) -> None:
    text = (
        (configs / "finger.yaml")
        .read_text()
        .replace("      left: {", "      wrist: {bus: servos, id: 3}\n      left: {")
    )
    text = text.replace("rest_mm: [60, 60]", "rest_mm: [60, 60]\n    extra_deg: {wrist: [-90, 90]}")
    more = ("velocity_deg_s: {}", "acceleration_deg_s2: 5000", "jerk_deg_s3: 100000")
    rates = "\n      ".join(("jerk_mm_s3: 20000", *more))
    assert parse_robot_file(text.replace("jerk_mm_s3: 20000", rates.format(600)), "finger.yaml")
    (message,) = refusals(text.replace("jerk_mm_s3: 20000", rates.format(700)))
    assert "rates.velocity_deg_s 700 needs 700" in message
    slow = text.replace("id: 3", "id: 3, profile_velocity_deg_s: 90").replace(
        "jerk_mm_s3: 20000", rates.format(300)
    )
    (message,) = refusals(slow)
    assert "profile_velocity_deg_s is 90 deg/s" in message


def test_a_motor_that_accelerates_less_than_its_rack(configs: Path) -> None:
    """A board follows commands at its limit of acceleration only with a reserve for catching up."""
    text = (configs / "trirack.emulated.yaml").read_text()
    needed = 1.2 * 900 / (math.pi * 25) * 360
    given = "channel: m1, mm_per_rev: 78.53981633974483, acceleration_deg_s2: {}"
    weak = text.replace(given.format(5200), given.format(round(needed - 1)))
    assert weak != text
    (message,) = refusals(weak)
    assert "acceleration_deg_s2 is 4949 deg/s2, but rates.acceleration_mm_s2 900 needs 4950" in message
    assert parse_robot_file(text.replace(given.format(5200), given.format(round(needed + 1))), "")


@pytest.mark.parametrize(
    ("written", "mistaken", "message"),
    [
        ("length_mm: [0, 100]", "length_mm: [0, 100000]", "device to 9.549e+05 deg; allowed: at most"),
        ("mm_per_rev: 37.69911184307752", "mm_per_rev: 37699", "are 11 steps of its device's encoder"),
        ("servos, id: ", "servos, zero_deg: 1e9, id: ", "device to 1e+09 deg; allowed: at most 92160"),
    ],
    ids=["limits", "pinion", "zero"],
)
def test_limits_beyond_the_turns_or_the_steps_of_a_servo(
    configs: Path, written: str, mistaken: str, message: str
) -> None:
    """Thousandfold mistakes of units: 256 turns to either side, and 4096 steps a turn (e-manual)."""
    text = (configs / "finger.yaml").read_text()
    messages = refusals(text.replace(written, mistaken))
    assert len(messages) == 2
    assert all(message in each for each in messages)
    assert parse_robot_file(text.replace(written, mistaken), "finger.yaml", recorded=True).buses


def test_metres_as_the_pinion_of_a_board(configs: Path) -> None:
    text = (configs / "trirack.emulated.yaml").read_text()
    wrong = text.replace("mm_per_rev: 78.53981633974483", "mm_per_rev: 78540, counts_per_rev: 2000")
    assert "steps of its device's encoder; allowed: at least 20" in refusals(wrong)[0]
