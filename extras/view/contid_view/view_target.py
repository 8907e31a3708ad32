"""Where a run is drawn: a window of the native viewer, a page on this machine, or a file."""

from __future__ import annotations

import enum
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from contid.errors import ContidError, require_extra

if TYPE_CHECKING:
    from contid.robot_file.load import LoadedFile


class ViewError(ContidError):
    """A run cannot be drawn there."""


class NoDisplayError(ViewError):
    """There is no display for a window; a run goes on without it."""


class Kind(enum.Enum):
    """The three kinds of targets."""

    SPAWN = "spawn"
    SERVE = "serve"
    FILE = "file"


@dataclass(frozen=True, slots=True)
class ViewTarget:
    """One target; ``path`` is that of a file, None for the other kinds."""

    kind: Kind
    path: Path | None = None


@dataclass(frozen=True, slots=True)
class ViewerJob:
    """Sent by the daemon to the viewer's process; ``pid`` is that of the ring's writer."""

    target: ViewTarget
    ring: Path
    pid: int
    loaded: LoadedFile
    rate_hz: float


def parse_view_target(text: str) -> ViewTarget:
    """The value of ``--view``.

    Raises:
        ViewError: it is not a target.
    """
    if text in (Kind.SPAWN.value, Kind.SERVE.value):
        return ViewTarget(Kind(text))
    if text.endswith(".rrd"):
        return ViewTarget(Kind.FILE, Path(text).absolute())
    raise ViewError(f"--view {text}: allowed: spawn (a window), serve (a page on this machine) or FILE.rrd")


def check(target: ViewTarget, environment: Mapping[str, str] = os.environ) -> None:
    """Refuse a target before the run starts.

    Raises:
        MissingExtraError: the viewer is not installed.
        NoDisplayError: a window without a display.
        ViewError: the folder does not exist, or the file does.
    """
    require_extra("--view", "rerun")
    if target.kind is Kind.SPAWN and not (environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY")):
        raise NoDisplayError(
            "no display for the viewer's window (neither DISPLAY nor WAYLAND_DISPLAY is set); "
            "a page for a browser (serve) or a file needs none"
        )
    if target.path is None:
        return
    if target.path.exists():
        raise ViewError(f"{target.path}: file exists; recordings are never overwritten")
    if not os.access(target.path.parent, os.W_OK):
        raise ViewError(f"{target.path.parent}: no such folder, or it cannot be written")
