"""A session as CSV, one file per channel or one table of everything; and its robot file.

Numbers keep the fewest digits that read back to the same value; what is absent is an empty cell. A joined
table puts the channel in front of a column.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, TextIO

from contid.control.engine.events import RunEvent
from contid.control.engine.events.json_form import to_json
from contid.errors import SessionError
from contid.session.format.channels import EVENT, MEASURED, TICK_CHANNELS
from contid.session.read import Session
from contid.whole_file import replacing
from contid_sessions.columns import TIMES
from contid_sessions.table import TickTable


@contextmanager
def _file(path: Path) -> Iterator[TextIO]:
    """A text file that is complete or not there: half a table looks like a short run."""
    with replacing(path) as file:
        text = io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True)
        try:
            yield text
        finally:
            text.detach()


def export_channels(session: Session, folder: Path) -> list[Path]:
    """Write one CSV per channel into a folder, created if absent; returns the files."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = "it is a file; give a folder, or a table FILE.csv" if folder.is_file() else error.strerror
        raise SessionError(f"{folder}: cannot write tables there: {message}") from error
    table = TickTable(session)
    tick_files = [channel for channel in (*TICK_CHANNELS, MEASURED) if channel in table.channels]
    paths = [folder / f"{channel}.csv" for channel in (*tick_files, EVENT)]
    with ExitStack() as stack:
        *tick_writers, events = [_writer(stack.enter_context(_file(path))) for path in paths]
        # Every file has the times, whose channel is "", and the columns of its own channel.
        column_indices = [
            [index for index, of_column in enumerate(table.channels) if of_column in ("", channel)]
            for channel in tick_files
        ]
        for writer, channel, indices in zip(tick_writers, tick_files, column_indices, strict=True):
            writer.writerow([table.names[index].removeprefix(f"{channel}.") for index in indices])
        events.writerow(["t_s", "unix_s", "event", "tick", "details"])

        def write_event(t_s: float, time_ns: int, event: RunEvent) -> None:
            details = to_json(event)
            kind, tick = details.pop("event"), details.pop("tick", "")
            events.writerow([t_s, f"{time_ns // 1000 / 1e6:.6f}", kind, tick, json.dumps(details)])

        cells = _cells(table)
        for block in table.blocks(write_event):
            for row in block.tolist():
                texts = cells(row)
                for writer, indices in zip(tick_writers, column_indices, strict=True):
                    writer.writerow([texts[index] for index in indices])
    return paths


def export_joined(session: Session, path: Path) -> list[Path]:
    """Write all tick channels as one table, one row per tick; returns the file."""
    table = TickTable(session)
    with _file(path) as file:
        writer = _writer(file)
        writer.writerow(table.names)
        cells = _cells(table)
        for block in table.blocks():
            writer.writerows(map(cells, block.tolist()))
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


def _cells(table: TickTable) -> Callable[[list[float]], list[str]]:
    """A function that turns a row of the table into the texts of its cells, "" for NaN."""
    unix_index = TIMES.index("unix_s")

    def cells(row: list[float]) -> list[str]:
        texts = [
            "" if value != value else (str(int(value)) if is_integer else repr(value))
            for value, is_integer in zip(row, table.is_integer, strict=True)
        ]
        texts[unix_index] = f"{row[unix_index]:.6f}"
        return texts

    return cells
