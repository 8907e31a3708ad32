"""The schematics and the table of docs/devices/due.md have the pins of the sketch."""

from __future__ import annotations

import re

from contid_devices.due.firmware_build import firmware_dir
from docs.drawings.svg import IMAGES
from docs.drawings.wiring import DRAWINGS

PINS = (firmware_dir() / "contid_due" / "src" / "due" / "pins.h").read_text(encoding="utf-8")


def test_pins_of_channel_0() -> None:
    (row,) = re.findall(r"\{(\d+), \d, (\d+), (\d+), (\d+), \d\},\s+// encoder D2, D13", PINS)
    motor, pressure = (DRAWINGS[name]().svg() for name in ("due-motor.svg", "due-pressure.svg"))
    for pin in (*row, "2", "13"):
        assert re.search(rf"\bD{pin}\b", motor)
    assert re.search(rf"\bD{row[0]}\b", pressure)
    jumper = re.search(r"ROLE_JUMPER = (\d+)", PINS)
    assert jumper
    assert f"D{jumper[1]}" in motor
    assert f"D{jumper[1]}" in pressure


def test_the_table_of_pins_is_the_sketchs() -> None:
    page = (IMAGES.parent / "devices" / "due.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| m\d / p\d \| D(\d+) \| D(\d+) D(\d+) \| D(\d+) D(\d+).* \| D(\d+) \|", page, re.MULTILINE
    )
    sketch = re.findall(r"\{(\d+), \d, (\d+), (\d+), (\d+), \d\},\s+// encoder D(\d+), D(\d+)", PINS)
    assert [(pwm, a, b, x, y, fault) for pwm, a, b, fault, x, y in sketch] == rows
