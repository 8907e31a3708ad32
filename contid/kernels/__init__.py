"""Compiled kernels of the models; each has a NumPy twin that is its specification."""

from __future__ import annotations

import logging
import os
import sys
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Final

__all__ = ["PURE_PYTHON", "in_use", "load", "warn_of_twins"]

LOG = logging.getLogger(__name__)

#: The kernels of a complete build; some are compiled a second time for AVX2.
KERNELS: Final = (
    "arc", "clearance", "cosserat", "finger", "ph_curve", "plant", "tendon", "tendon_rod", "text",
)  # fmt: skip

#: Set to anything but 0 to disable the compiled kernels.
PURE_PYTHON: Final = "CONTID_PURE_PYTHON"


def load(name: str) -> ModuleType | None:
    """The kernel ``contid.kernels._name``, or None if it is not compiled or ``CONTID_PURE_PYTHON`` is set.

    Called when a model is built, so that one process can hold both kinds (tests compare them).
    """
    if _disabled():
        return None
    kernel = (_imported(f"{name}_avx2") if has_avx2() else None) or _imported(name)
    if kernel is None:
        _warn_once()
    return kernel


def warn_of_twins() -> None:
    """Log once that no kernel is compiled, for a process whose children compute."""
    load(KERNELS[0])


def in_use() -> str:
    """Which arithmetic the models use, for reports: compiled kernels or NumPy twins, and why."""
    if _disabled():
        return f"NumPy twins ({PURE_PYTHON} is set)"
    missing = [name for name in KERNELS if _imported(name) is None]
    if not missing:
        return "compiled, AVX2" if has_avx2() and _imported("cosserat_avx2") else "compiled"
    return f"NumPy twins for {', '.join(missing)}: about 1000 times slower; {_remedy()}"


def _disabled() -> bool:
    return os.environ.get(PURE_PYTHON, "") not in ("", "0")


@cache
def _warn_once() -> None:
    """One line per process: on stderr in a script, in the log of a daemon."""
    LOG.warning("contid uses NumPy twins, about 1000 times slower than its kernels: %s", _remedy())


def _remedy() -> str:
    """How to get the kernels: install the checkout that was imported, or what a build needs."""
    root = Path(__file__).resolve().parents[2]
    if (root / "CMakeLists.txt").is_file():
        return f"run '{sys.executable} -m pip install -e {root}', or start outside {root}"
    return "install g++ and the Python headers (Debian: apt install g++ python3-dev), then reinstall contid"


@cache
def has_avx2() -> bool:
    """Whether this processor has AVX2; the kernels built for it have the same results."""
    try:
        return " avx2 " in Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False


@cache
def _imported(name: str) -> ModuleType | None:
    module = f"contid.kernels._{name}"
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        return None
