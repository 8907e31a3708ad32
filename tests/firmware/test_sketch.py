"""The sketch: Arduino only where it belongs, names that the Due has, and a fuzzer that finds nothing."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from contid_devices.due.firmware_build import firmware_dir

pytestmark = pytest.mark.process

SKETCH = firmware_dir() / "contid_due"
HERE = Path(__file__).parent
BOARD_LAYERS = ("due", "teensy41")


def compile_sketch(source: str | Path, *flags: str) -> subprocess.CompletedProcess[str]:
    warnings = ["-std=gnu++11", "-Wall", "-Wextra", "-Werror", "-Wconversion"]
    include = ["-I", str(HERE / "arduino_sam"), "-I", str(SKETCH)]
    command = ["g++", *warnings, *include, "-DARDUINO_ARCH_SAM", "-fsyntax-only", *flags, str(source)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_arduino_is_confined_to_the_board_layer():
    def uses(path: Path) -> bool:
        return (
            re.search(r"Arduino\.h|\b(digitalWrite|analogWrite|Serial|millis|delay)\b", path.read_text())
            is not None
        )

    files = [path for path in firmware_dir().rglob("*") if path.suffix in (".h", ".cpp", ".ino")]
    assert {path.parent.name for path in files if uses(path)} == set(BOARD_LAYERS)


@pytest.mark.parametrize("path", sorted((SKETCH / "src" / "due").glob("*.cpp")), ids=lambda path: path.name)
def test_the_board_layer_uses_only_names_of_the_due_core(path):
    # The chip's 32-bit addresses are narrower than a pointer of this computer.
    done = compile_sketch(path, "-Wno-int-to-pointer-cast")
    assert done.returncode == 0, done.stderr


def test_a_name_that_the_core_lacks_does_not_compile(tmp_path):
    text = (SKETCH / "src" / "due" / "hal.cpp").read_text().replace("delay(1)", "wdt_reset()")
    text = text.replace('"../', f'"{SKETCH / "src"}/')
    broken = tmp_path / "hal.cpp"
    broken.write_text(text)
    done = compile_sketch(broken, "-I", str(SKETCH / "src" / "due"))
    assert "wdt_reset" in done.stderr


def test_the_sketch_compiles(tmp_path):
    # The IDE puts Arduino.h in front and compiles the .ino as C++.
    ino = tmp_path / "contid_due.cpp"
    ino.write_text("#include <Arduino.h>\n" + (SKETCH / "contid_due.ino").read_text())
    done = compile_sketch(ino)
    assert done.returncode == 0, done.stderr


def test_core_survives_the_macros_of_arduino(tmp_path):
    for source in sorted((SKETCH / "src" / "core").rglob("*.cpp")):
        wrapped = tmp_path / source.name
        wrapped.write_text(f'#include <Arduino.h>\n#include "{source}"\n')
        done = compile_sketch(wrapped)
        assert done.returncode == 0, done.stderr


def test_no_analog_write_no_unasked_traffic_no_heap():
    for path in SKETCH.rglob("*.*"):
        code = re.sub(r"//.*", "", path.read_text())
        assert not re.search(r"\banalogWrite\b|\bprint(ln)?\b|\bmalloc\b|\bnew\b|\bString\b|\bstd::", code), (
            path
        )


def test_pins_are_used_once():
    text = (SKETCH / "src" / "due" / "pins.h").read_text()
    rows = re.findall(r"\{(\d+), (\d), (\d+), (\d+), (\d+), (\d)\},\s+// encoder D(\d+), D(\d+)", text)
    assert len(rows) == 6
    pins = [int(pin) for row in rows for pin in (row[0], row[2], row[3], row[4], row[6], row[7])]
    jumper = re.search(r"ROLE_JUMPER = (\d+)", text)
    assert jumper
    assert len({*pins, int(jumper[1])}) == 6 * 6 + 1
    edges = re.findall(r"\{(\d+), (\d+), \d\}", text.split("EDGE_PINS[4]")[1].split(";")[0])
    assert [(int(a), int(b)) for a, b in edges] == [(int(row[6]), int(row[7])) for row in rows[2:]]
    assert len({row[1] for row in rows}) == len({row[5] for row in rows}) == 6


@pytest.mark.campaign
def test_fuzzer():
    """The vectors, which are its seeds, run in CI (test_vectors)."""
    inputs = os.environ.get("CONTID_FUZZ_INPUTS", "10000")
    command = [sys.executable, str(firmware_dir() / "fuzz.py"), inputs]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
