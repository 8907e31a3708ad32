"""How late all ticks of a run started, in a few classes: for observers that ask now and then."""

from __future__ import annotations

from bisect import bisect_left
from typing import Final

from contid.control.daemon.interfaces import RunControl
from contid.remote.protocol.wire import Fields

#: Upper bounds of the classes [us]; the last class has none.
BOUNDS_US: Final = (50, 100, 250, 500, 1_000, 2_500, 5_000, 10_000, 50_000)


class LatenessHistogram:
    """Counts ticks by their lateness; `update` takes in those since the last call."""

    def __init__(self, control: RunControl) -> None:
        self._control = control
        self._counts = [0] * (len(BOUNDS_US) + 1)
        self._sum_s = 0.0
        self._seen = 0

    def update(self) -> None:
        """Take in new ticks; of more than the ring holds only those that it holds."""
        record = self._control.newest()
        if record is None:
            return
        ticks = record.tick + 1 - record.skipped
        if ticks <= self._seen:
            return
        for late_s in self._control.lateness(ticks - self._seen):
            self._counts[bisect_left(BOUNDS_US, late_s * 1e6)] += 1
            self._sum_s += late_s
        self._seen = ticks

    def as_fields(self) -> Fields:
        """The field ``lateness_classes`` of ``status``."""
        return {"le_us": list(BOUNDS_US), "counts": list(self._counts), "sum_us": round(self._sum_s * 1e6, 1)}
