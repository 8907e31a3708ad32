"""Times of rows: units, epochs, wraps, rounded clocks, sessions, times that repeat or run back."""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from contid.errors import BadInputError
from contid_adapt.meaning.expression import affine, evaluate, names_in, numbers_of
from contid_adapt.meaning.mapping import Mapping, MappingLine
from contid_adapt.reading.cells import number
from contid_adapt.reading.table import Table

Floats: TypeAlias = NDArray[np.float64]

#: Times between rows that clocks of trackers and robots have [s].
_LEAST_S: Final = 4e-4
_GREATEST_S: Final = 2.0
#: Longest time without a sample where the mapping states nothing: this, or this number of usual times [s].
_GAP_S: Final = 0.5
_GAP_ROWS: Final = 4.0
#: Times beyond this one are epochs: whole seconds are taken away [s].
_EPOCH_S: Final = 1e6
_WRAP: Final = 2**32
_RATES: Final = ("FREQUENCY", "Frequency", "Export Frame Rate", "Capture Frame Rate", "DataRate")


def stated_rates(table: Table) -> list[tuple[str, float]]:
    """Rows per second that the preamble of a file states, with their names there."""
    rates = [(key, number(table.facts.get(key, "none given"))) for key in _RATES]
    step = (
        number(table.facts.get("Delta_X", "none given"))
        if table.facts.get("X_Dimension", "Time") == "Time"
        else None
    )
    rates += [("Delta_X", 1.0 / step)] if step else []  # LabVIEW: seconds between rows
    return [(key, rate) for key, rate in rates if rate]


def pick_session(table: Table, mapping: Mapping) -> Table:
    """The rows of the chosen session.

    Raises:
        BadInputError: there are several and the mapping names none, or one that is not there.
    """
    sessions = table.sessions.copy()
    if mapping.time is not None and (sessions == sessions[0]).all() and "session" in mapping.numbers:
        steps = np.diff(_seconds(table, mapping, mapping.time, [])[0])
        sessions = 1 + np.concatenate(([0], np.cumsum(steps < -1e-9)))
    count = int(sessions.max())
    chosen = mapping.numbers.get("session")
    if chosen is None:
        if count == 1:
            return table
        row = int(np.flatnonzero(np.diff(sessions))[0]) + 1
        found = f"{count} sessions: another header stands above this row; write `session: 1` to {count}"
        raise BadInputError([table.at(row, None, found)])
    if chosen != int(chosen) or not 1 <= chosen <= count:
        raise mapping.wrong("session", f"no session {chosen:g}; the file has {count}")
    return table.chosen(sessions == int(chosen))


def times_of(table: Table, mapping: Mapping, notes: list[str]) -> Floats:
    """The time of every row [s]; of a table without a clock by the given rate.

    Raises:
        BadInputError: no time, two, or times that no clock has.
    """
    rate = mapping.numbers.get("rate_hz")
    stated = stated_rates(table)
    if mapping.time is None and rate is None:
        hint = "".join(f" (the file states {key} {value:g})" for key, value in stated)
        names = table.named("time")
        message = f"no time: write `t_s:` and the column, or `rate_hz:` with rows per second{hint}; {names}"
        raise mapping.wrong("t_s", message)
    if rate is not None:
        if mapping.time is not None:
            raise mapping.wrong("rate_hz", "a time and a rate; one of them")
        if stated and all(abs(value - rate) > 1e-3 * rate for _, value in stated):
            raise mapping.wrong("rate_hz", f"{rate:g}, but the file states {stated[0][0]} {stated[0][1]:g}")
        for each in table.columns:
            if each.name.lower() in ("frame", "frame#", "frame_index", "k") and not each.is_text:
                steps = np.diff(each.values.astype(float))
                if len(steps) and np.any(steps != steps[0]):
                    row = int(np.flatnonzero(steps != steps[0])[0]) + 1
                    remedy = f"write `t_s: {each.alias}/{rate:g}` in place of rate_hz"
                    raise BadInputError(
                        [table.at(row, each, f"{each.name} does not count every row; {remedy}")]
                    )
        return np.arange(len(table)) / rate
    assert mapping.time is not None
    times, first = _seconds(table, mapping, mapping.time, notes)
    column = table.column(names_in(mapping.time.node)[0])
    if np.isnan(times).any():
        row = int(np.flatnonzero(np.isnan(times))[0])
        raise BadInputError([table.at(row, column, "the row has no time")])
    steps = np.diff(times)
    usual = float(np.median(steps)) if len(steps) else 0.0
    if len(steps) and (steps == 0.0).mean() > 0.1 and usual < _LEAST_S:
        same = int((steps == 0.0).sum())
        row = int(np.flatnonzero(steps == 0.0)[0]) + 1
        what = f"{same} of {len(table)} rows have the time of the row before: the clock is rounded"
        remedy = "or several bodies share a time; choose one with `rows:`, or give `rate_hz:`"
        raise BadInputError([table.at(row, column, f"{what}, {remedy}")])
    if len(steps) and usual > max(_GREATEST_S, mapping.numbers.get("gap_s", 0.0)):
        form, (unit, larger) = affine(mapping.time.node), _smaller(usual)
        plain = form is not None and 1.0 in form.factors.values()
        hint = f"is {column.name!r} in {unit}?" if plain else f"is its factor {larger:g} times too large?"
        what = f"rows are {usual:.3g} s apart: {hint}"
        raise mapping.wrong("t_s", f"{what} (`gap_s:` allows long times)")
    if len(steps) and 0.0 < usual < _LEAST_S:
        what = (
            f"rows are {usual:.3g} s apart, {1 / usual:.0f} a second: is the factor of {column.name!r} right?"
        )
        raise mapping.wrong("t_s", what)
    _check_rate(stated, steps, usual, mapping, notes)
    begins = first
    if abs(first) >= _EPOCH_S:
        begins = first - float(np.floor(first))
        notes.append(f"time: {np.floor(first):.0f} s were taken away, so it begins at {begins:.6g} s")
    result: Floats = times + begins
    return result


def check_order(
    table: Table, times: Floats, mapping: Mapping, values: Floats, notes: list[str]
) -> NDArray[np.bool_]:
    """Which rows to keep so that time grows.

    Raises:
        BadInputError: time runs back, repeats with other values, or no sample comes for long.
    """
    column = table.column(names_in(mapping.time.node)[0]) if mapping.time else None
    keep = np.ones(len(times), dtype=bool)
    if len(times) < 2:
        return keep
    steps = np.diff(times)
    if (steps < 0.0).any():
        row = int(np.flatnonzero(steps < 0.0)[0]) + 1
        what = f"time runs back by {-steps[row - 1]:.4g} s"
        remedy = "another session or body? write `session: 1`, or `rows:` with a condition"
        raise BadInputError([table.at(row, column, f"{what}; {remedy}")])
    equal = np.flatnonzero(steps < 1e-4 * (1 - 1e-3))
    if len(equal):
        differ = np.any(values[equal + 1] != values[equal], axis=1) & (steps[equal] == 0.0)
        if differ.any() and differ.sum() > max(0.01 * len(times), 1):
            row = int(equal[differ][0]) + 1
            remedy = f"several bodies in one table? choose one with `rows:`{_choices(table)}"
            raise BadInputError([table.at(row, column, f"time repeats with another position; {remedy}")])
        keep[equal + 1] = False
        notes.append(f"{len(equal)} rows with the time of the row before were left out")
    kept = times[keep]
    gaps = np.diff(kept)
    usual = float(np.median(gaps)) if len(gaps) else 0.0
    allowed = mapping.numbers.get("gap_s", max(_GAP_S, _GAP_ROWS * usual))
    long = np.flatnonzero(gaps > allowed * (1.0 + 1e-9))
    if len(long):
        row = int(np.flatnonzero(keep)[long[0] + 1])
        what = f"no sample for {gaps[long[0]]:.4g} s before this row ({len(long)} times)"
        remedy = f"write `gap_s: {np.ceil(gaps.max() * 10) / 10:g}` to allow it"
        raise BadInputError([table.at(row, column, f"{what}; {remedy}")])
    return keep


def _seconds(
    table: Table, mapping: Mapping, line: MappingLine, notes: list[str]
) -> tuple[NDArray[np.float64], float]:
    """Seconds since the first row, and the time of the first row; integers are subtracted as integers."""
    used = names_in(line.node)
    if not used:
        raise mapping.wrong("t_s", "the time names no column; for a fixed rate write `rate_hz:`")
    columns = {name: numbers_of(table, name) for name in used}
    form = affine(line.node)
    if form is None:
        values: Floats = evaluate(line.node, table)
        since_first: Floats = values - values[0]
        return since_first, float(values[0])
    times: Floats = np.zeros(len(table))
    first = form.constant
    for name, factor in form.factors.items():
        values = columns[name].values
        since = (values - values[0]).astype(float)
        drops = np.flatnonzero(np.diff(since) < -0.5 * _WRAP)
        if len(drops) and len(used) == 1 and np.abs(values.astype(float)).max() < _WRAP:
            since = since + _WRAP * np.concatenate(([0], np.cumsum(np.diff(since) < -0.5 * _WRAP)))
            notes.append(f"{columns[name].name}: a counter of 32 bits wrapped {len(drops)} times")
        times += factor * since
        first += factor * float(values[0])
    return times, first


def _check_rate(
    stated: list[tuple[str, float]], steps: Floats, usual: float, mapping: Mapping, notes: list[str]
) -> None:
    """Refuse times that contradict a stated rate, by their usual step and by their mean (a rounded clock)."""
    if stated and usual > 0.0 and all(abs(usual * value - 1.0) > 0.05 for _, value in stated):
        key, value = stated[0]
        if abs(float(steps.mean()) * value - 1.0) < 5e-3:
            notes.append(
                f"the clock is rounded: steps of {usual:.4g} s at {key} {value:g}; `rate_hz:` is even"
            )
            return
        raise mapping.wrong("t_s", f"rows are {usual:.4g} s apart, but the file states {key} {value:g}")


def _smaller(step: float) -> tuple[str, float]:
    return ("ms", 1e3) if step < 2000.0 else ("us", 1e6) if step < 2e6 else ("ns", 1e9)


def _choices(table: Table) -> str:
    """Columns with few different values, which may name bodies."""
    for each in table.columns:
        head = [str(value) for value in each.values[:2000]]
        found = list(dict.fromkeys(head))
        if 2 <= len(found) <= 12 and each.is_text:
            return f", such as `rows: {each.alias} == '{found[0]}'`"
        if 2 <= len(found) <= 12 and float(found[0]).is_integer() and len(head) >= 3 * len(found):
            return f", such as `rows: {each.alias} == {float(found[0]):g}`"
    return ""
