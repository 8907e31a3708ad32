"""An emulated board whose firmware crashes is reported, not only seen as a lost port."""

from __future__ import annotations

import signal

import psutil
import pytest

from contid.errors import DeviceError
from contid_drivers.due.options import DueBusOptions, Role
from contid_emulate.due import DueEmulator
from tests.wire.due.boards import MOTORS

pytestmark = pytest.mark.process


def board_process() -> psutil.Process:
    return next(child for child in psutil.Process().children() if "--pty" in child.cmdline())


@pytest.mark.parametrize("fault", [signal.SIGFPE, signal.SIGSEGV])
def test_a_crash_is_reported(tmp_path, fault):
    options = DueBusOptions(port=str(tmp_path / "board"), role=Role.MOTOR)
    with (
        pytest.raises(DeviceError, match=f"firmware of the emulated board.*crashed with {fault.name}"),
        DueEmulator(options, MOTORS),
    ):
        board_process().send_signal(fault)


def test_an_end_from_outside_is_none(tmp_path):
    options = DueBusOptions(port=str(tmp_path / "board"), role=Role.MOTOR)
    with DueEmulator(options, MOTORS):
        board_process().send_signal(signal.SIGINT)
