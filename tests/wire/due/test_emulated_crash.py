"""An emulated board whose firmware crashes is reported, not only seen as a lost port."""

from __future__ import annotations

import signal
from contextlib import suppress

import psutil
import pytest

from contid.errors import DeviceError
from contid_drivers.due.options import DueBusOptions, Role
from contid_emulate.due import DueEmulator
from contid_emulate.tracking import moving
from tests.support.waiting import until
from tests.wire.due.boards import MOTORS

pytestmark = pytest.mark.process


def board_process() -> psutil.Process:
    """The process of the board; this process may have other children, which end meanwhile."""
    for child in psutil.Process().children():
        with suppress(psutil.NoSuchProcess):
            if "--pty" in child.cmdline():
                return child
    raise AssertionError("no board runs")


@pytest.mark.parametrize("fault", [signal.SIGFPE, signal.SIGSEGV])
def test_a_crash_is_reported(tmp_path, fault):
    options = DueBusOptions(port=str(tmp_path / "board"), role=Role.MOTOR)
    with (
        pytest.raises(DeviceError, match=f"firmware of the emulated board.*crashed with {fault.name}"),
        DueEmulator(options, MOTORS),
    ):
        board_process().send_signal(fault)


def test_a_command_to_a_board_that_has_ended_is_refused_as_such(tmp_path):
    options = DueBusOptions(port=str(tmp_path / "board"), role=Role.MOTOR)
    with DueEmulator(options, MOTORS) as emulator:
        process = board_process()
        process.send_signal(signal.SIGINT)
        process.wait(60.0)
        for _ in range(2):  # the first one may still fit into the pipe
            with pytest.raises(DeviceError, match=r"the emulated board .* has ended"):
                emulator.command("get 0")


def test_bodies_whose_board_has_ended_are_reported():
    class Ended:
        def advance(self, now_s: float) -> list[object]:
            raise DeviceError("due emulator", "the emulated board has ended")

    lines: list[str] = []
    with moving(Ended(), None, lines.append):  # type: ignore[arg-type]
        until(lambda: lines, "it is reported")
    assert lines == ["bodies no longer move: due emulator: the emulated board has ended"]


def test_an_end_from_outside_is_none(tmp_path):
    options = DueBusOptions(port=str(tmp_path / "board"), role=Role.MOTOR)
    with DueEmulator(options, MOTORS):
        board_process().send_signal(signal.SIGINT)
