"""Compiled kernels of the models; each has a NumPy twin that is its specification."""

from __future__ import annotations

import os
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Final

__all__ = ["PURE_PYTHON", "load"]

#: Set to anything but 0 to disable the compiled kernels.
PURE_PYTHON: Final = "CONTID_PURE_PYTHON"


def load(name: str) -> ModuleType | None:
    """The kernel ``contid.kernels._name``, or None if it is not compiled or ``CONTID_PURE_PYTHON`` is set.

    Called when a model is built, so that one process can hold both kinds (tests compare them).
    """
    if os.environ.get(PURE_PYTHON, "") not in ("", "0"):
        return None
    return (_imported(f"{name}_avx2") if has_avx2() else None) or _imported(name)


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
