"""The setup that the daemon sends to the control process."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

from contid.control.engine.cycle import OnEnd
from contid.robot_file.load import LoadedFile
from contid.trajectory.timed import Trajectory


@dataclass(frozen=True, slots=True)
class RunSetup:
    """The first message on the pipe.

    Attributes:
        loaded: the robot file, checked already.
        rate_hz: ticks per second.
        ring: path of the ring to write.
        trajectory: timed rows to follow, or None.
        on_end: what to do at its end.
        attended: orders may follow, so the run does not end when every robot is in FAULT.
        armed: arm at once; False to connect and wait for `resume`.
        log_level: lowest level of log records in the recording.
    """

    loaded: LoadedFile
    rate_hz: float
    ring: Path
    trajectory: Trajectory | None
    on_end: OnEnd
    attended: bool
    armed: bool = True
    log_level: int = logging.INFO
