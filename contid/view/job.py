"""The job of a viewer's process."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from contid.robot_file.load import LoadedFile
from contid.view.view_target import ViewTarget


@dataclass(frozen=True, slots=True)
class ViewerJob:
    """Sent by the daemon to the viewer's process.

    Attributes:
        target: where to draw.
        ring: to read.
        pid: of the ring's writer.
        loaded: the robot file.
        rate_hz: of the ticks.
    """

    target: ViewTarget
    ring: Path
    pid: int
    loaded: LoadedFile
    rate_hz: float
