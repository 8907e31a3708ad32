"""What the daemon hands to the viewer's process."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from contid.robot_file.load import LoadedFile
from contid.view.view_target import ViewTarget


@dataclass(frozen=True, slots=True)
class ViewerJob:
    """What a viewer needs to know.

    Attributes:
        where: the picture goes.
        ring: to read.
        pid: of its writer.
        loaded: the robot file.
        rate_hz: of the ticks.
    """

    where: ViewTarget
    ring: Path
    pid: int
    loaded: LoadedFile
    rate_hz: float
