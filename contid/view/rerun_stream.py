"""A Rerun recording on the time lines of a run: static data, columns and banners."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from contid.view import paths


class RerunStream:
    """One recording."""

    def __init__(self, recording: rr.RecordingStream, rate_hz: float) -> None:
        self._recording = recording
        self.rate_hz = rate_hz

    def static(self, entity: str, what: Any) -> None:
        """Log what never changes."""
        self._recording.log(entity, what, static=True)

    def send(self, entity: str, ticks: Sequence[int], columns: Any) -> None:
        """Log columns, a row per tick."""
        seconds = np.array(ticks) / self.rate_hz
        times = [rr.TimeColumn(paths.TICK, sequence=ticks), rr.TimeColumn(paths.TIME, duration=seconds)]
        self._recording.send_columns(entity, indexes=times, columns=columns)
