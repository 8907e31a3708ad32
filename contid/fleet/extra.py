"""The packages of the extra ``contid[fleet]``."""

from __future__ import annotations

from importlib.util import find_spec

from contid.errors import MissingExtraError


def require_extra() -> None:
    """Refuse to go on without Zenoh.

    Raises:
        MissingExtraError: with the remedy.
    """
    if find_spec("zenoh") is None:
        raise MissingExtraError("the fleet", "eclipse-zenoh", "fleet")
