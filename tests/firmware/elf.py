"""Segments and symbols of a linked program."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Image:
    """A linked program: segments by address, addresses of symbols."""

    segments: tuple[tuple[int, bytes], ...]
    symbols: Mapping[str, int]


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
    for _, kind, _, _, offset, size, link, _, _, _ in sections:
        if kind == 2:  # the symbol table; `link` is its string table
            names = sections[link][4]
            for at in range(offset, offset + size, 16):
                name, value = struct.unpack_from("<II", data, at)
                end = data.index(b"\0", names + name)
                symbols[data[names + name : end].decode()] = value
    return Image(tuple(segments), symbols)
