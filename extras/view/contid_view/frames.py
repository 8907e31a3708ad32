"""Decimation of ticks to some thirty frames a second without hiding a late tick.

A frame is the last record of its interval with the worst lateness and the longest work of the interval. A
live view drops the other ticks; a drawing of a session keeps them in its curves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from contid.control.engine.tick_layout import LATENESS, TICK, WORK, RecordLayout, TickRecord

FRAMES_HZ: Final = 30.0
#: Frames of a file are written together: a batch costs little more than one frame.
BATCH: Final = 30


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame.

    Attributes:
        record: the last one of the interval.
        lateness_s: the worst of the interval.
        work_s: the longest of the interval.
        drawn: also in space, not only in the curves.
    """

    record: TickRecord
    lateness_s: float
    work_s: float
    drawn: bool = True


class Decimator:
    """Turns the values of records into frames and writes them in batches."""

    def __init__(
        self,
        layout: RecordLayout,
        write: Callable[[Sequence[Frame]], None],
        batch: int,
        curves: bool = False,
    ) -> None:
        """Prepare.

        Args:
            layout: layout of the records.
            write: takes the frames, oldest first.
            batch: frames per call of ``write``.
            curves: make every record a frame, and draw the last of each interval.
        """
        self._layout = layout
        self._write = write
        self._batch = batch
        self._curves = curves
        self._per_tick = min(FRAMES_HZ / layout.rate_hz, 1.0)
        self._interval = -1
        self._values: Sequence[float] = ()
        self._lateness_s = self._work_s = 0.0
        self._frames: list[Frame] = []

    def add(self, values: Sequence[float]) -> None:
        """Add a record; the frame before it is complete when its interval is."""
        interval = int(values[TICK] * self._per_tick)
        if interval != self._interval or self._curves:
            self._complete(drawn=interval != self._interval)
            self._interval = interval
            if len(self._frames) >= self._batch:
                self._flush()
        self._values = values
        self._lateness_s = max(self._lateness_s, values[LATENESS])
        self._work_s = max(self._work_s, values[WORK])

    def finish(self) -> None:
        """Write what is left, the frame of the incomplete interval included."""
        self._complete(drawn=True)
        self._flush()

    def _complete(self, drawn: bool) -> None:
        if not self._values:
            return
        record = self._layout.decode(tuple(self._values))
        self._frames.append(Frame(record, self._lateness_s, self._work_s, drawn))
        self._values, self._lateness_s, self._work_s = (), 0.0, 0.0

    def _flush(self) -> None:
        self._write(self._frames)
        self._frames.clear()
