"""The sketch linked with the core of the Teensy 4.1, as its own Makefile does; cached by content.

`CONTID_TEENSY_CORE` names the folder ``teensy4`` of a checkout of PaulStoffregen/cores. The compiler is
Debian's gcc-arm-none-eabi with libnewlib-arm-none-eabi and libstdc++-arm-none-eabi-newlib.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from contid_devices.due.firmware_build import cache_dir, firmware_dir

_FLAGS = (
    "-Os", "-g", "-ffunction-sections", "-fdata-sections", "-mcpu=cortex-m7", "-mfloat-abi=hard",
    "-mfpu=fpv5-d16", "-mthumb", "-DF_CPU=600000000", "-DUSB_SERIAL", "-DLAYOUT_US_ENGLISH",
    "-D__IMXRT1062__", "-DARDUINO=10813", "-DTEENSYDUINO=159", "-DARDUINO_TEENSY41",
)  # fmt: skip
_CXX = (
    "-std=gnu++17", "-fno-exceptions", "-fpermissive", "-fno-rtti", "-fno-threadsafe-statics",
    "-felide-constructors",
)  # fmt: skip
_TOOL = "arm-none-eabi-"


def build_sketch(core: Path) -> Path:
    """The ELF file of sketch and core."""
    sketch = firmware_dir() / "contid_due"
    sources = sorted((sketch / "src").rglob("*.cpp"))
    ino = sketch / "contid_due.ino"
    digest = hashlib.sha256(" ".join((*_FLAGS, *_CXX, str(core))).encode())
    for path in (*sources, *sorted((sketch / "src").rglob("*.h")), ino):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    folder = cache_dir() / f"teensy41-{digest.hexdigest()[:16]}"
    program = folder / "contid.elf"
    if program.is_file():
        return program
    folder.mkdir(parents=True, exist_ok=True)
    strict = ["-Wall", "-Wextra", "-Werror", "-isystem", str(core), f"-I{sketch}"]
    tasks = [(_command(core, path), path) for path in sorted(core.glob("*.c*")) if path.suffix != ".cc"]
    tasks += [(["gcc", "-x", "assembler-with-cpp", f"-I{core}"], path) for path in sorted(core.glob("*.S"))]
    tasks += [(["g++", *_CXX, *strict], path) for path in sources]
    tasks += [(["g++", *_CXX, *strict, "-x", "c++", "-include", "Arduino.h"], ino)]

    def compile_one(number: int) -> Path:
        (tool, *flags), source = tasks[number]
        made = folder / f"{number}.o"
        _run(tool, *flags, *_FLAGS, "-c", str(source), "-o", str(made))
        return made

    with ThreadPoolExecutor(2) as pool:
        objects = [str(path) for path in pool.map(compile_one, range(len(tasks)))]
    fresh = folder / f"fresh.{os.getpid()}"
    link = ("-Os", "-Wl,--gc-sections,--relax", f"-T{core / 'imxrt1062_t41.ld'}", *_FLAGS[4:8])
    _run("gcc", *link, "-o", str(fresh), *objects, "-lm", "-lstdc++")
    fresh.replace(program)
    return program


def _command(core: Path, path: Path) -> list[str]:
    if path.suffix == ".c":
        return ["gcc", "-std=gnu11", "-w", f"-I{core}"]
    return ["g++", *_CXX, "-w", f"-I{core}"]


def _run(tool: str, *arguments: str) -> None:
    done = subprocess.run([_TOOL + tool, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
