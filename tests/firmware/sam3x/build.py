"""The sketch linked for the SAM3X8E without the Arduino core, by PyPI's ``ziglang``; cached by content."""

from __future__ import annotations

import fcntl
import hashlib
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from contid_devices.due.firmware_build import SKETCH_STANDARD, cache_dir, firmware_dir

STAND_IN = Path(__file__).parents[1] / "arduino_sam"

_FLAGS = (
    "-target", "thumb-freestanding-eabi", "-mcpu=cortex_m3", SKETCH_STANDARD, "-Os", "-g", "-fno-rtti",
    "-ffunction-sections", "-fdata-sections", "-fno-exceptions", "-fno-builtin", "-fno-sanitize=undefined",
    "-fno-threadsafe-statics", "-Wall", "-Wextra", "-Werror", "-DARDUINO_ARCH_SAM", "-Wl,--gc-sections",
)  # fmt: skip


def build_sketch() -> Path:
    """The ELF file of sketch, core stand-in and start-up."""
    sketch = firmware_dir() / "contid_due"
    sources = [STAND_IN / "core.cpp", *sorted((sketch / "src").rglob("*.cpp"))]
    headers = [*sorted((sketch / "src").rglob("*.h")), *sorted(STAND_IN.rglob("*.h")), STAND_IN / "flash.ld"]
    ino = sketch / "contid_due.ino"
    digest = hashlib.sha256(" ".join(_FLAGS).encode())
    for path in (*sources, *headers, ino):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    program = cache_dir() / f"sketch-{digest.hexdigest()[:16]}.elf"
    if program.is_file():
        return program
    program.parent.mkdir(parents=True, exist_ok=True)
    with program.with_name(f"{program.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # one worker builds, the others wait for it
        if not program.is_file():
            _build(program, sketch, sources, ino)
    return program


def _build(program: Path, sketch: Path, sources: Sequence[Path], ino: Path) -> None:
    fresh = program.with_name(f"{program.name}.{os.getpid()}")
    include = ["-I", str(STAND_IN), "-I", str(firmware_dir() / "m3"), "-I", str(sketch)]
    command = [
        *(sys.executable, "-m", "ziglang", "c++", *_FLAGS, *include, f"-Wl,-T,{STAND_IN / 'flash.ld'}"),
        *("-o", str(fresh), *map(str, sources), "-x", "c++", "-include", "Arduino.h", str(ino)),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    fresh.replace(program)
