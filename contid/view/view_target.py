"""Where a picture goes: a window of the native viewer, a page on this machine, or a file."""

from __future__ import annotations

import enum
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from contid.errors import ContidError


class ViewError(ContidError):
    """A picture cannot be shown or written where it was asked for."""


class NoDisplayError(ViewError):
    """There is nowhere to open a window; a robot can do without."""


class Kind(enum.Enum):
    """The three places."""

    SPAWN = "spawn"
    SERVE = "serve"
    FILE = "file"


@dataclass(frozen=True, slots=True)
class ViewTarget:
    """One place.

    Attributes:
        kind: which of the three.
        path: of the file, None for the others.
    """

    kind: Kind
    path: Path | None = None


def parse_where(text: str) -> ViewTarget:
    """The place that ``--view`` names.

    Raises:
        ViewError: it names none.
    """
    if text in (Kind.SPAWN.value, Kind.SERVE.value):
        return ViewTarget(Kind(text))
    if text.endswith(".rrd"):
        return ViewTarget(Kind.FILE, Path(text).absolute())
    raise ViewError(f"--view {text}: say spawn (a window), serve (a page on this machine) or FILE.rrd")


def require(where: ViewTarget, environment: Mapping[str, str] = os.environ) -> None:
    """Refuse now what could only fail later.

    Raises:
        NoDisplayError: a window was asked for, without a display.
        ViewError: no such folder, or a file that is there already.
    """
    if where.kind is Kind.SPAWN and not (environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY")):
        raise NoDisplayError(
            "no display for the viewer's window (neither DISPLAY nor WAYLAND_DISPLAY is set); "
            "a page for a browser (serve) or a file needs none"
        )
    if where.path is None:
        return
    if where.path.exists():
        raise ViewError(f"{where.path}: is there already; a recording is never overwritten")
    if not os.access(where.path.parent, os.W_OK):
        raise ViewError(f"{where.path.parent}: no such folder, or it cannot be written")
