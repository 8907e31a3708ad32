"""What ``fk`` and ``ik`` share: rows of a CSV or NDJSON in, one answer per row out, as they come."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from typing import TextIO

import click

from contid.description.load import LoadedFile
from contid.errors import BadInputError, Located
from contid.targets import Target
from contid.trajectory.rows import RowReader, is_comment, numbered_lines

Cell = float | int | bool | str
Answer = Callable[[Mapping[str, Target]], dict[str, Cell]]


def answer_rows(loaded: LoadedFile, source: TextIO, answer: Answer, as_json: bool) -> None:
    """Read targets row by row and print what ``answer`` makes of them; ``t_s`` is passed through.

    Raises:
        BadInputError: at the first wrong row; the rows before it have been answered.
    """
    header: tuple[str, ...] | None = None
    for cells in _answers(loaded, source, answer):
        if as_json:
            click.echo(json.dumps(cells))
            continue
        if header is None:
            header = tuple(cells)
            click.echo(",".join(header))
        click.echo(",".join(_text(value) for value in cells.values()))


def _answers(loaded: LoadedFile, source: TextIO, answer: Answer) -> Iterator[dict[str, Cell]]:
    name = getattr(source, "name", "stdin").strip("<>")
    reader: RowReader | None = None
    for number, line in numbered_lines(source):
        if is_comment(line):
            continue
        if reader is None:
            reader = RowReader(line, number, name, loaded.file.robots)
            if not reader.is_json:
                continue
        row = reader.row(line, number)
        time = reader.layout.time
        try:
            cells = answer(reader.layout.targets(row))
        except BadInputError:
            raise
        except ValueError as error:
            raise BadInputError([Located(name, number, 1, str(error))]) from error
        if time is not None:
            cells = {"t_s": row[time], **cells}
        yield cells
    if reader is None:
        raise BadInputError([Located(name, 1, 1, "no rows: the first line is a header such as x_mm,y_mm")])


def front(loaded: LoadedFile, robot: str) -> str:
    """What stands before a quantity in a column: nothing when there is only one robot."""
    return "" if len(loaded.file.robots) == 1 else f"{robot}."


def _text(value: Cell) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)


def open_rows(path: str | None) -> TextIO:
    """The file named, or stdin; a terminal on stdin is a mistake worth a word."""
    if path is not None and path != "-":
        return click.open_file(path, encoding="utf-8")  # type: ignore[return-value]  # text mode
    if sys.stdin.isatty():
        raise click.UsageError("give rows on stdin or name a file: contid fk ROBOT.yaml rows.csv")
    return sys.stdin
