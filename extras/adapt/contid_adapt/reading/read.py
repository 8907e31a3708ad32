"""Any file to a table."""

from __future__ import annotations

from pathlib import Path

from contid_adapt.reading.lines import lines_of
from contid_adapt.reading.objects import read_objects
from contid_adapt.reading.source import read_source
from contid_adapt.reading.table import Table
from contid_adapt.reading.text_table import read_text


def read_table(path: str | Path) -> Table:
    """The table of a file: CSV and its dialects, JSON, or a format known by its first bytes.

    Raises:
        ContidError: it cannot be read, or is no table; findings have line and column.
    """
    source = read_source(path)
    if source.kind != "text":
        from contid_adapt.reading.binary import read_binary

        return read_binary(source)
    lines, name, note = lines_of(source.data), source.name, source.note
    whole_end = source.data.endswith((b"\n", b"\r"))
    table = read_objects(lines, name)
    if table is None:
        table = read_text(lines, name, whole_end)
    if note:
        table.notes.insert(0, note)
    return table
