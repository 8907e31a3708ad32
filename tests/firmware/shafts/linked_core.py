"""The firmware's core for programs of trials, compiled once for all of them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from contid_devices.due.firmware_build import WARNINGS, build_once, core_sources, firmware_dir

_COMPILER = ("g++", "-std=gnu++17", "-O2", *WARNINGS, f"-I{firmware_dir()}")


def build_with_core(name: str, source: Path, included: Iterable[Path]) -> Path:
    """A program of one source and the core."""
    core = build_once("core", [*_COMPILER, "-r", "-nostdlib"], core_sources(), [], ".o")
    included = [*included, firmware_dir() / "host" / "identity.h"]
    return build_once(name, _COMPILER, [core, source], included)
