"""Two buses of one file on one device."""

from __future__ import annotations

from pathlib import Path

import pytest

from contid.errors import BadInputError
from contid.robot_file.load import parse_robot_file

LINE = "  {name}: {{driver: dynamixel, port: {port}}}\n"


def file_of(configs: Path, first: str, second: str) -> str:
    text = (configs / "finger.yaml").read_text()
    head = text[: text.index("buses:")]
    body = text[text.index("robots:") :]
    buses = "buses:\n" + LINE.format(name="servos", port=first) + LINE.format(name="more", port=second)
    return head + buses + body


def test_two_buses_on_one_device_are_refused_under_any_name(configs: Path, tmp_path: Path) -> None:
    device, other = tmp_path / "ttyUSB0", tmp_path / "ttyUSB1"
    device.touch()
    other.touch()
    (tmp_path / "by-id").mkdir()
    link = tmp_path / "by-id" / "usb-1a86"
    link.symlink_to(device)
    for name in (device, link, f"{tmp_path}/by-id/usb-*"):
        with pytest.raises(BadInputError, match="is the device of bus servos as well"):
            parse_robot_file(file_of(configs, str(device), str(name)), "robot.yaml")
    with pytest.raises(BadInputError, match="is the device of bus servos as well"):
        parse_robot_file(file_of(configs, "/dev/absent", "/dev/../dev/absent"), "robot.yaml")
    parse_robot_file(file_of(configs, str(device), str(other)), "robot.yaml")
