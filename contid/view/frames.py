"""From every tick to what an eye can follow: some thirty frames a second that hide no late tick.

A frame is the last record of its interval, with the worst lateness and the longest work of all records in
it, so that one late tick in a thousand is still seen. Values of other ticks are dropped while a robot runs;
a recording keeps them in its curves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from contid.control.engine.tick_layout import RecordLayout, TickRecord

FRAMES_HZ: Final = 30.0
#: Frames of a file are written together: a batch costs little more than one.
BATCH: Final = 30
_LATENESS, _WORK = 3, 4


@dataclass(frozen=True, slots=True)
class Frame:
    """One picture.

    Attributes:
        record: the last one of the interval.
        lateness_s: the worst of the interval.
        work_s: the longest of the interval.
        drawn: also in space, not in curves alone.
    """

    record: TickRecord
    lateness_s: float
    work_s: float
    drawn: bool = True


class Decimator:
    """Takes the bare values of every record, gives a frame whenever an interval is complete.

    With ``curves`` every record is a frame, and the last of each interval is one that is drawn.
    """

    def __init__(self, layout: RecordLayout, curves: bool = False, frames_hz: float = FRAMES_HZ) -> None:
        self._layout = layout
        self._curves = curves
        self._per_tick = min(frames_hz / layout.rate_hz, 1.0)
        self._interval = -1
        self._values: Sequence[float] = ()
        self._lateness_s = self._work_s = 0.0

    def add(self, values: Sequence[float]) -> Frame | None:
        """The frame that the record after it completes, if this one does."""
        interval = int(values[0] * self._per_tick)
        done = None
        if interval != self._interval or self._curves:
            done = self._frame(drawn=interval != self._interval)
            self._interval = interval
        self._values = values
        self._lateness_s = max(self._lateness_s, values[_LATENESS])
        self._work_s = max(self._work_s, values[_WORK])
        return done

    def rest(self) -> Frame | None:
        """The frame of the interval that was not complete yet."""
        return self._frame(drawn=True)

    def _frame(self, drawn: bool) -> Frame | None:
        if not self._values:
            return None
        frame = Frame(self._layout.decode(tuple(self._values)), self._lateness_s, self._work_s, drawn)
        self._values, self._lateness_s, self._work_s = (), 0.0, 0.0
        return frame
