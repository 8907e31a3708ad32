"""The compiled kernels: every solver of contid, once, in C++17."""

from __future__ import annotations

import sys
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Final

from contid.errors import ContidError

__all__ = ["KernelMissingError", "in_use", "load", "require"]

#: The kernels of a complete build; some are compiled a second time for AVX2.
KERNELS: Final = (
    "arc", "clearance", "cosserat", "dynamics", "finger", "limiter", "ph_curve", "plant", "tendon",
    "tendon_rod", "text",
)  # fmt: skip


class KernelMissingError(ContidError):
    """A kernel is not compiled in this installation, or cannot be loaded; the message has the remedy."""

    def __init__(self, name: str, reason: str = "is not compiled") -> None:
        self.kernel = name
        super().__init__(f"{Path(__file__).parent}: contid's kernel '{name}' {reason}: {_remedy()}")


def require() -> None:
    """Check that the kernels are compiled, without loading them: before devices are opened.

    Raises:
        KernelMissingError: One of them is not compiled in this installation.
    """
    for name in KERNELS:
        if find_spec(f"contid.kernels._{name}") is None:
            raise KernelMissingError(name)


def load(name: str) -> ModuleType:
    """The kernel ``contid.kernels._NAME``, built for AVX2 where there is one and the processor has it.

    Raises:
        KernelMissingError: It is not compiled in this installation, or cannot be loaded.
    """
    kernel = (_imported(f"{name}_avx2") if has_avx2() else None) or _imported(name)
    if kernel is None:
        raise KernelMissingError(name)
    return kernel


def in_use() -> str:
    """Which build of the kernels serves, for reports.

    Raises:
        KernelMissingError: One of them is not compiled in this installation, or cannot be loaded.
    """
    for name in KERNELS:
        load(name)
    return "compiled, AVX2" if has_avx2() and _imported("cosserat_avx2") else "compiled"


def _remedy() -> str:
    """How to get the kernels: install the checkout that was imported, or contid again."""
    root = Path(__file__).resolve().parents[2]
    if (root / "CMakeLists.txt").is_file():
        return f"run '{sys.executable} -m pip install -e {root}', or start outside {root}"
    again = f"run '{sys.executable} -m pip install --force-reinstall --no-deps contid'"
    return f"{again}; building it needs g++ and the Python headers (Debian: apt install g++ python3-dev)"


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
    except ImportError as error:  # compiled for another system
        raise KernelMissingError(name, f"cannot be loaded ({error})") from error
