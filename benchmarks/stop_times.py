"""When recorded ticks obeyed stops, and cells of tables of times."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Sequence

from contid.control.engine.tick_layout import DEADLINE, RecordLayout
from contid.control.tick.supervisor import Mode


def obeyed_after(
    records: Iterable[Sequence[float]], layout: RecordLayout, sent_s: Iterable[float]
) -> list[float]:
    """From each stop to the deadline of the first tick with every robot OFF [s], in order of size.

    Args:
        records: of a session, in their order.
        layout: of the records.
        sent_s: when each stop began, by the clock of the deadlines.
    """
    off = [
        values[DEADLINE]
        for values in records
        if all(robot.mode == Mode.OFF for robot in layout.decode(tuple(values)).robots)
    ]
    return sorted(off[min(bisect_left(off, at_s), len(off) - 1)] - at_s for at_s in sent_s)


def cells(ordered_s: Sequence[float], shares: Sequence[float], per_s: float, digits: int) -> list[str]:
    """Percentiles as cells of a table.

    Args:
        ordered_s: in order of size [s].
        shares: 0.5 for the median.
        per_s: units of the table per second.
        digits: after the point.
    """
    return [f"{ordered_s[int(share * (len(ordered_s) - 1))] * per_s:.{digits}f}" for share in shares]
