"""Cells with dates, times of day and durations, as integers of nanoseconds.

Dates are those of ISO 8601 (pandas, InfluxDB, ROS tools; also with ``/``), of MATLAB (``01-May-2024``) and
those with points (``01.05.2024``, the day first). A date such as ``05/01/2024`` is not read: whether its day
or its month comes first differs from country to country.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contid_adapt.reading.cells import is_lost

_CLOCK: Final = r"(?P<h>\d{1,2}):(?P<m>\d\d):(?P<s>\d\d)(?:[.,](?P<f>\d{1,9}))?"
_DATE: Final = (
    r"(?P<year>\d{4})[-/](?P<month>\d\d)[-/](?P<day>\d\d)"
    r"|(?P<D>\d\d)(?:-(?P<Mon>[A-Z][a-z]{2})-|\.(?P<M>\d\d)\.)(?P<Y>\d{4})"
)
_ZONE: Final = r"(?P<zone>Z|[+-]\d\d:?\d\d)?"
_MONTHS: Final = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
_OF_DAY: Final = "nanoseconds since midnight"
#: What a cell may hold, and what the nanoseconds are counted from.
_FORMS: Final = (
    (re.compile(rf"(?:{_DATE})[T ]{_CLOCK} ?{_ZONE}"), "nanoseconds since 1970"),
    (re.compile(_CLOCK), _OF_DAY),
    (re.compile(rf"(?P<days>\d+) days? {_CLOCK}"), "nanoseconds"),
    (re.compile(r"(?P<m>\d{1,3}):(?P<s>\d\d)[.,](?P<f>\d{1,9})"), "nanoseconds, from minutes and seconds"),
    (re.compile(r"(?P<amount>[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?) ?(?P<unit>sec|s|ms|msec)"), "nanoseconds"),
)
#: Cells that are looked at to decide, and the part of them all that may be no times.
_SAMPLE: Final = 20
_MOST_BAD: Final = 0.05
_NS: Final = 10**9
_HALF_DAY: Final = 12 * 3600 * _NS
_NS_OF_UNIT: Final = {"s": 10**9, "sec": 10**9, "ms": 10**6, "msec": 10**6}
_EPOCH: Final = datetime.date(1970, 1, 1).toordinal()


class TimeColumn(NamedTuple):
    """Times.

    Attributes:
        values: nanoseconds, shape ``(rows,)``; those of the row before where a cell has none.
        since: what they are counted from, for a note.
        bad: rows and cells that are no times.
    """

    values: NDArray[np.int64]
    since: str
    bad: list[tuple[int, str]]


def times_of_texts(cells: Sequence[str]) -> TimeColumn | None:
    """The times of cells that are written alike; None where more than a part of them are anything else."""
    typical = [cell.strip() for cell in cells[:: max(len(cells) // _SAMPLE, 1)]]
    for form, since in _FORMS:
        if 2 * sum(bool(form.fullmatch(cell)) for cell in typical) <= len(typical):
            continue
        values, bad, nanoseconds = np.empty(len(cells), np.int64), [], 0
        for row, cell in enumerate(cells):
            found = form.fullmatch(cell.strip())
            time = _nanoseconds(found) if found else None
            if time is None:
                bad.append((row, cell))
            else:
                nanoseconds = time
            values[row] = nanoseconds
        if len(bad) > _MOST_BAD * len(cells) and len(bad) > 1:
            return None
        return TimeColumn(_past_midnight(values) if since == _OF_DAY else values, since, bad)
    return None


def looks_like_time(cell: str) -> bool:
    """True for a cell that `times_of_texts` reads."""
    return not is_lost(cell) and any(form.fullmatch(cell.strip()) for form, _ in _FORMS)


def _past_midnight(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """Times of day that grow on: behind a step back by more than half a day another day has begun."""
    days = np.concatenate([[0], np.cumsum(np.diff(values) < -_HALF_DAY)])
    later: NDArray[np.int64] = values + 2 * _HALF_DAY * days
    return later


def _nanoseconds(found: re.Match[str]) -> int | None:
    parts = found.groupdict()
    if "amount" in parts:
        return round(float(parts["amount"]) * _NS_OF_UNIT[parts["unit"]])
    hours, minutes, seconds = int(parts.get("h") or 0), int(parts["m"]), int(parts["s"])
    if hours > 23 or ("h" in parts and minutes > 59) or seconds > 60:
        return None
    days = int(parts.get("days") or 0)
    if parts.get("year") or parts.get("Y"):
        try:
            days = _ordinal(parts) - _EPOCH
        except ValueError:
            return None
    whole_s = ((24 * days + hours) * 60 + minutes) * 60 + seconds - _offset_s(parts.get("zone"))
    return whole_s * _NS + int((parts["f"] or "0").ljust(9, "0"))


def _ordinal(parts: dict[str, str]) -> int:
    if parts["year"]:
        return datetime.date(int(parts["year"]), int(parts["month"]), int(parts["day"])).toordinal()
    month = _MONTHS.index(parts["Mon"]) + 1 if parts["Mon"] else int(parts["M"])
    return datetime.date(int(parts["Y"]), month, int(parts["D"])).toordinal()


def _offset_s(zone: str | None) -> int:
    if zone is None or zone == "Z":
        return 0
    sign = -1 if zone[0] == "-" else 1
    return sign * (60 * int(zone[1:3]) + int(zone[-2:])) * 60
