"""Ids and baud rates that no servo has are refused before anything is sent."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
from click.testing import CliRunner

from contid.errors import DeviceError
from contid_devices import scan, servo
from contid_devices.dynamixel.commission import check_free


def test_an_id_beyond_a_byte_is_refused() -> None:
    with pytest.raises(DeviceError, match="no servo has id 300; allowed 0 to 252"):
        check_free(cast(Any, SimpleNamespace(path="/dev/ttyUSB0", port=None)), 300, 57600)


@pytest.mark.parametrize("baud", ["0", "-5"])
def test_a_baud_rate_is_positive(baud: str) -> None:
    for command, rest in ((scan.command, ()), (servo.command, ("read", "1"))):
        done = CliRunner().invoke(command, ("--baud", baud, *rest))
        assert done.exit_code == 2
        assert "'--baud'" in done.output
