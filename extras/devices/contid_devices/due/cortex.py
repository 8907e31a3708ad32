"""The firmware core built for a Cortex-M by the clang in PyPI's ``ziglang``, and its size.

Sizes are estimates: the Arduino IDE compiles with gcc 4.8 and adds its own core (21 KB flash, 2.6 KB RAM).
"""

from __future__ import annotations

import struct
import sys
from pathlib import Path
from typing import Final, NamedTuple

from contid_devices.due.firmware_build import SKETCH_STANDARD, build_once, core_sources, firmware_dir

#: Size of the Arduino core, measured for a small sketch (reference: hardware facts, section 1).
ARDUINO_FLASH: Final = 21 * 1024
ARDUINO_RAM: Final = 2662
FLASH_BYTES: Final = 512 * 1024
RAM_BYTES: Final = 96 * 1024
RAM_START: Final = 0x2007_0000

_FLAGS: Final = (
    "-target", "thumb-freestanding-eabi", SKETCH_STANDARD, "-Os", "-g",
    "-ffunction-sections", "-fdata-sections", "-fno-exceptions", "-fno-rtti", "-fno-builtin",
    "-fno-sanitize=undefined", "-fno-threadsafe-statics", "-Wall", "-Wextra", "-Werror", "-Wconversion",
    "-Wl,--gc-sections",
)  # fmt: skip


def build_core(processor: str = "cortex_m3") -> Path:
    """The ELF file of the core for a processor, built anew when its sources changed.

    Args:
        processor: ``cortex_m3``, of the Due, or ``cortex_m7``, of the Teensy 4.1.

    Raises:
        DeviceError: the build fails.
    """
    m3 = firmware_dir() / "m3"
    flags = (*_FLAGS, f"-mcpu={processor}", "-I", str(m3), f"-Wl,-T,{m3 / 'due.ld'}")
    compiler = [sys.executable, "-P", "-m", "ziglang", "c++", *flags]
    included = [*m3.iterdir(), m3.parent / "host" / "identity.h"]
    return build_once(processor, compiler, [m3 / "entry.cpp", *core_sources()], included, ".elf")


class MemoryUse(NamedTuple):
    """Bytes that a program needs."""

    flash: int
    ram: int


def memory_use(program: Path) -> MemoryUse:
    """Flash and RAM of a 32-bit little-endian ELF file, by its program headers."""
    data = program.read_bytes()
    (start,) = struct.unpack_from("<I", data, 28)
    size, count = struct.unpack_from("<HH", data, 42)
    flash = ram = 0
    for at in range(start, start + count * size, size):
        kind, _, address, _, in_file, in_memory = struct.unpack_from("<6I", data, at)
        if kind != 1:  # not loaded
            continue
        # Initialised data lies in flash as well, to be copied from.
        flash += in_file
        ram += in_memory if address >= RAM_START else 0
    return MemoryUse(flash, ram)
