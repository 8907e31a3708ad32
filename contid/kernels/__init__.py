"""Native hot paths behind the models; every one has a NumPy twin in ``contid.models`` that specifies it."""

from __future__ import annotations

import os
from importlib import import_module
from types import ModuleType
from typing import Final

#: Set to anything but 0 to leave the native kernels aside.
PURE_PYTHON: Final = "CONTID_PURE_PYTHON"


def native(name: str) -> ModuleType | None:
    """The compiled kernel ``contid.kernels._<name>``, or None: not built, or switched off.

    Asked when a model is built, so that one process can hold both kinds (tests compare them).
    """
    if os.environ.get(PURE_PYTHON, "0") not in ("", "0"):
        return None
    try:
        return import_module(f"contid.kernels._{name}")
    except ImportError:
        return None
