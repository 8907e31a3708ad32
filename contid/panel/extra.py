"""The packages of the extra ``contid[panel]``."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Final

from contid.errors import ContidError

PACKAGES: Final = ("starlette", "uvicorn", "websockets")


def require_extra() -> None:
    """Refuse to go on without the packages.

    Raises:
        ContidError: one is missing.
    """
    missing = [name for name in PACKAGES if find_spec(name) is None]
    if missing:
        raise ContidError(f"the panel needs {', '.join(missing)}: pip install 'contid[panel]'")
