"""A session as CSV, one file per channel or one table of everything; and its robot file.

Units are those of robot files, and tip positions have the columns of a trajectory (``ROBOT.x_mm``); a joined
table puts the channel in front. Numbers keep the fewest digits that read back to the same value; what is
absent is an empty cell. Every row has three times: ``t_s`` since tick 0 by the clock, ``robot_s`` by the
ticks that ran (the time of the robots), and ``unix_s``, the time of day since 1970.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TextIO

from contid.control.engine.events import to_json
from contid.control.engine.tick_layout import SKIPPED, TICK
from contid.session.format.channels import TICK_CHANNELS, Field, fields
from contid.session.format.entries import Entry
from contid.session.format.mcap_records import MAGIC
from contid.session.output import exists_error, replacing
from contid.session.read import Session, SessionError

_VECTORS: Final = {
    "tip_m": ("x_mm", "y_mm", "z_mm"),
    "direction": ("ax", "ay", "az"),
    "mid_m": ("mid.x_mm", "mid.y_mm", "mid.z_mm"),
    "measured_tip_m": ("meas.x_mm", "meas.y_mm", "meas.z_mm"),
    "measured_direction": ("meas.ax", "meas.ay", "meas.az"),
    "load_n": ("load.fx_n", "load.fy_n", "load.fz_n"),
}


#: First columns of every table of ticks.
TIMES: Final = ("tick", "t_s", "robot_s", "unix_s")


@dataclass(frozen=True, slots=True)
class Column:
    """One column.

    Attributes:
        name: with its unit.
        slot: place in a record.
        scale: from SI to the unit; None for integers.
    """

    name: str
    slot: int
    scale: Callable[[float], float] | None


def columns(session: Session, channel: str) -> list[Column]:
    """The columns of a channel after `TIMES`."""
    values = fields(session.layout, session.device_units, channel)
    return [column for each in values if each.path != ("tick",) for column in _columns(each)]


def _columns(each: Field) -> Iterator[Column]:
    front = ".".join(each.path[1:-1] if each.path[0] == "robots" else each.path[:-1])
    front += "." if front else ""
    key = each.path[-1]
    if each.kind == "array":
        scale = _to_mm if key.endswith("_m") else _same
        for name, slot in zip(_VECTORS[key], each.slots, strict=True):
            yield Column(front + name, slot, scale)
        return
    for end, new, scale in _UNITS:
        if key.endswith(end):
            yield Column(front + key.removesuffix(end) + new, each.slots[0], scale)
            return
    whole = each.kind in ("integer", "boolean")
    yield Column(front + key, each.slots[0], None if whole else _same)


def _same(value: float) -> float:
    return value


def _to_mm(value: float) -> float:
    return value * 1e3


def _to_bar(value: float) -> float:
    return value / 1e5


#: Suffix of a key in SI -> suffix of a column, and the conversion.
_UNITS: Final = (
    ("_pa_s", "_bar_s", _to_bar),
    ("_pa", "_bar", _to_bar),
    ("_m", "_mm", _to_mm),
    ("measured_age_s", "meas.age_s", _same),
)


@contextmanager
def _file(path: Path) -> Iterator[TextIO]:
    """A text file that is complete or not there: half a table looks like a short run."""
    with replacing(path) as file:
        text = io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True)
        try:
            yield text
        finally:
            text.detach()


def refuse_recording(path: Path) -> None:
    """Recordings are never overwritten, by exports neither.

    Raises:
        ContidError: the file is a recording.
    """
    if path.is_file():
        with path.open("rb") as file:
            if file.read(len(MAGIC)) == MAGIC:
                raise exists_error(path)


def export_channels(session: Session, folder: Path) -> list[Path]:
    """Write one CSV per channel into a folder, created if absent; returns the files."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = "it is a file; give a folder, or a table FILE.csv" if folder.is_file() else error.strerror
        raise SessionError(f"{folder}: cannot write tables there: {message}") from error
    tables = {channel: columns(session, channel) for channel in TICK_CHANNELS}
    paths = [folder / f"{channel}.csv" for channel in (*TICK_CHANNELS, "event")]
    with ExitStack() as stack:
        *ticks, events = [_writer(stack.enter_context(_file(path))) for path in paths]
        for writer, table in zip(ticks, tables.values(), strict=True):
            writer.writerow([*TIMES, *(column.name for column in table)])
        events.writerow(["t_s", "unix_s", "event", "tick", "details"])
        zero_ns = _zero_ns(session)
        for entry in session.entries():
            if entry.values is not None:
                for writer, table in zip(ticks, tables.values(), strict=True):
                    writer.writerow(_row(session, entry, zero_ns, table))
            elif entry.event is not None:
                rest = to_json(entry.event)
                kind, tick = rest.pop("event"), rest.pop("tick", "")
                t_s, unix_s = _since(entry.time_ns, zero_ns), _unix(entry.time_ns)
                events.writerow([t_s, unix_s, kind, tick, json.dumps(rest)])
    return paths


def export_joined(session: Session, path: Path) -> list[Path]:
    """Write all tick channels as one table, one row per tick; returns the file."""
    of_channel = [(channel, column) for channel in TICK_CHANNELS for column in columns(session, channel)]
    table = [column for _, column in of_channel]
    with _file(path) as file:
        writer = _writer(file)
        writer.writerow([*TIMES, *(f"{channel}.{column.name}" for channel, column in of_channel)])
        zero_ns = _zero_ns(session)
        for entry in session.entries():
            if entry.values is not None:
                writer.writerow(_row(session, entry, zero_ns, table))
    return [path]


def export_robot_file(session: Session, path: Path) -> None:
    """Write the text of the robot file; an existing file is never replaced.

    Raises:
        ContidError: the file exists, or cannot be written.
    """
    if path.exists():
        raise SessionError(f"{path}: file exists; robot files are never overwritten")
    with _file(path) as file:
        file.write(session.robot_text)


def _writer(file: TextIO) -> Any:
    return csv.writer(file, lineterminator="\n")


def _zero_ns(session: Session) -> int:
    """The time of day of tick 0 [ns]: where ``t_s`` begins."""
    for entry in session.entries():
        if entry.values is not None:
            return entry.time_ns - round(entry.values[TICK] / session.rate_hz * 1e9)
    return int(session.metadata["clock"]["wall_ns"])


def _since(time_ns: int, zero_ns: int) -> float:
    return (time_ns - zero_ns) / 1e9


def _unix(time_ns: int) -> str:
    return f"{time_ns // 1000 / 1e6:.6f}"


def _row(session: Session, entry: Entry, zero_ns: int, table: Sequence[Column]) -> list[Any]:
    values = entry.values
    assert values is not None
    cells: list[Any] = [
        int(values[TICK]),
        _since(entry.time_ns, zero_ns),
        (values[TICK] - values[SKIPPED]) / session.rate_hz,
        _unix(entry.time_ns),
    ]
    for column in table:
        value = values[column.slot]
        if value != value:
            cells.append("")
        elif column.scale is None:
            cells.append(int(value))
        else:
            cells.append(repr(column.scale(value)))
    return cells
