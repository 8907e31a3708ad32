"""The lines of a load cell's converter, against a chip of the data sheet's words (HX711, figure 2)."""

from __future__ import annotations

import subprocess

import pytest

from contid_devices.due.firmware_build import WARNINGS, build_once, firmware_dir
from tests.firmware.tendons.trials import HERE

pytestmark = pytest.mark.process

READINGS = (0, 1, -1, 8388607, -8388608, 123456, -654321)


def test_readings_are_shifted_out_and_the_chip_is_left_at_its_channel():
    flags = ["g++", "-std=gnu++11", *WARNINGS, f"-I{firmware_dir()}"]
    included = [firmware_dir() / "contid_due" / "src" / "converter.h"]
    program = build_once("converter", flags, [HERE / "converter.cpp"], included)
    asked = "\n".join(map(str, READINGS))
    lines = subprocess.run([program], input=asked, capture_output=True, text=True, check=True).stdout.split()
    # Nothing is clocked while DOUT is high; then 25 pulses, which leave the clock low and DOUT high.
    assert lines == [f"0,25,0,1,{reading}" for reading in READINGS]
