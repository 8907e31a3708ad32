"""The firmware core built for a Cortex-M by the clang in PyPI's ``ziglang``, and the ELF file read back.

Sizes are estimates: the Arduino IDE compiles with gcc 4.8 and adds its own core (21 KB flash, 2.6 KB RAM).
"""

from __future__ import annotations

import hashlib
import os
import struct
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from contid.errors import DeviceError
from contid_drivers.due.firmware import SKETCH_STANDARD, cache_dir, core_sources, firmware_dir

#: Size of the Arduino core, measured for a small sketch (reference: hardware facts, section 1).
ARDUINO_FLASH: Final = 21 * 1024
ARDUINO_RAM: Final = 2662
FLASH_BYTES: Final = 512 * 1024
RAM_BYTES: Final = 96 * 1024
FLASH_START: Final = 0x0008_0000
RAM_START: Final = 0x2007_0000

_FLAGS: Final = (
    "-target", "thumb-freestanding-eabi", SKETCH_STANDARD, "-Os", "-g",
    "-ffunction-sections", "-fdata-sections", "-fno-exceptions", "-fno-rtti", "-fno-builtin",
    "-fno-sanitize=undefined", "-fno-threadsafe-statics", "-Wall", "-Wextra", "-Werror", "-Wconversion",
    "-Wl,--gc-sections",
)  # fmt: skip


@dataclass(frozen=True)
class Image:
    """A linked program: segments by address, addresses of symbols, bytes of flash and RAM."""

    segments: tuple[tuple[int, bytes], ...]
    symbols: Mapping[str, int]
    flash: int
    ram: int


def build_core(processor: str = "cortex_m3") -> Path:
    """The ELF file of the core for a processor, built anew when its sources changed.

    Args:
        processor: ``cortex_m3``, of the Due, or ``cortex_m7``, of the Teensy 4.1.

    Raises:
        DeviceError: ``ziglang`` is not installed, or the build fails.
    """
    if find_spec("ziglang") is None:
        raise DeviceError(
            "firmware", "the build for Cortex-M needs the package ziglang", "pip install ziglang"
        )
    m3 = firmware_dir() / "m3"
    sources = [m3 / "entry.cpp", *core_sources()]
    flags = (*_FLAGS, f"-mcpu={processor}")
    digest = hashlib.sha256(" ".join(flags).encode())
    for path in (*sources, *sorted(sources[1].parent.glob("*.h")), *sorted(m3.iterdir())):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    program = cache_dir() / f"{processor}-{digest.hexdigest()[:16]}.elf"
    if program.is_file():
        return program
    program.parent.mkdir(parents=True, exist_ok=True)
    fresh = program.with_name(f"{program.name}.{os.getpid()}")
    command = [
        *(sys.executable, "-P", "-m", "ziglang", "c++", *flags, "-I", str(m3), f"-Wl,-T,{m3 / 'due.ld'}"),
        *("-o", str(fresh), *map(str, sources)),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise DeviceError("firmware", f"the build for {processor} fails:\n{done.stderr.strip()}")
    fresh.replace(program)
    return program


def read_elf(path: Path) -> Image:
    """Read a 32-bit little-endian ELF file."""
    data = path.read_bytes()
    phoff, shoff = struct.unpack_from("<II", data, 28)
    phentsize, phnum, shentsize, shnum = struct.unpack_from("<HHHH", data, 42)
    segments = []
    for i in range(phnum):
        kind, offset, vaddr, _, filesz, memsz = struct.unpack_from("<6I", data, phoff + i * phentsize)
        if kind == 1 and memsz:
            segments.append((vaddr, data[offset : offset + filesz] + bytes(memsz - filesz)))
    sections = [struct.unpack_from("<10I", data, shoff + i * shentsize) for i in range(shnum)]
    symbols: dict[str, int] = {}
    flash = ram = 0
    for _, kind, flags, address, offset, size, link, _, _, _ in sections:
        if kind == 2:  # the symbol table; `link` is its string table
            names = sections[link][4]
            for at in range(offset, offset + size, 16):
                name, value = struct.unpack_from("<II", data, at)
                end = data.index(b"\0", names + name)
                symbols[data[names + name : end].decode()] = value
        if flags & 2:  # SHF_ALLOC: takes memory on the device
            in_ram = address >= RAM_START
            ram += size if in_ram else 0
            # Initialised data lies in flash as well, to be copied from.
            flash += size if not in_ram or kind != 8 else 0
    return Image(tuple(segments), symbols, flash, ram)
