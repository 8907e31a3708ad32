"""``contid servo`` and ``contid scan --find-port`` at the prompt."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import pytest
from click.testing import CliRunner

from contid.errors import ContidError
from contid_devices.scan import find_by_unplugging
from contid_devices.servo import command
from contid_emulate.dynamixel import DynamixelEmulator, Servo


@pytest.mark.realtime
def test_registers_at_the_prompt() -> None:
    with DynamixelEmulator([Servo(2, position_ticks=77.0)], paced=False) as bus:

        def servo(*arguments: str) -> str:
            done = CliRunner().invoke(command, ["--port", bus.port, *arguments])
            assert done.exit_code == 0, done.output
            return done.output

        assert servo("read", "2", "present_position").split() == ["132", "present", "position", "77", "tick"]
        assert servo("write", "2", "position_p_gain", "500") == "position_p_gain is 500 now\n"
        assert '"value": 500' in servo("read", "2", "84", "--json")
        assert "factory settings" in servo("reset", "2", "--yes")
        assert '"value": 400' in servo("read", "2", "84", "--json")


def test_a_command_for_one_servo_needs_a_port() -> None:
    done = CliRunner().invoke(command, ["blink", "1"])
    assert done.exit_code == 2
    assert "--port PORT" in done.output


@pytest.mark.process
def test_a_prompt_without_a_person_ends_with_a_message(contid: Callable[..., CompletedProcess[str]]) -> None:
    """It ended with exit code 130, as after Ctrl-C, and without a word."""
    contid("new", "mine", "--from", "finger")
    done = contid("servo", "setup", "mine.yaml")
    assert done.returncode == 2
    assert "stdin ended where an answer was expected" in done.stderr


def test_the_port_that_disappears_is_the_one(tmp_path: Path) -> None:
    (tmp_path / "serial" / "by-id").mkdir(parents=True)
    for name in ("ttyUSB0", "ttyUSB1", "ttyACM0"):
        (tmp_path / name).touch()
    link = tmp_path / "serial" / "by-id" / "usb-FTDI_U2D2-if00"
    link.symlink_to(tmp_path / "ttyUSB1")

    def unplug(request: str) -> None:
        assert request == "Unplug the adapter"
        link.unlink()
        (tmp_path / "ttyUSB1").unlink()

    assert find_by_unplugging(unplug, tmp_path) == str(link)
    with pytest.raises(ContidError, match="no port disappeared"):
        find_by_unplugging(lambda request: None, tmp_path)
