"""Lines of CSV or NDJSON to rows of SI numbers, with the line and column of everything that is wrong."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import islice
from typing import Final

from contid.errors import BadInputError, Located
from contid.robot_file.robot import RobotDescription
from contid.targets import Target
from contid.trajectory.columns import MAX_FINDINGS, ColumnLayout, read_layout
from contid.trajectory.surface_columns import BesideSurfaceError
from contid.units import MAX_LINE

#: Two million rows are almost three hours at 200 Hz.
MAX_ROWS: Final = 2_000_000
#: Maximum number in a row, as written: 10 000 km, 300 years. Squares of larger ones overflow in the models.
MAX_NUMBER: Final = 1e10


class RowReader:
    """Reads one header, then rows.

    A header that begins with ``{`` is NDJSON: it is the first row too. Anything else is the header of a CSV.

    Raises:
        BadInputError: from the constructor, when the header is wrong.
    """

    def __init__(
        self, header: str, name: str, robots: Mapping[str, RobotDescription], number: int = 1
    ) -> None:
        header = header.rstrip("\r\n").removeprefix("\ufeff")
        self.name = name
        self.is_json = header.lstrip().startswith("{")
        if len(header) > MAX_LINE:
            raise BadInputError([Located(name, number, 1, _too_long())])
        if self.is_json:
            pairs = self._object(header, number)
            columns = [(key, _key_column(header, key)) for key, _ in pairs]
        else:
            columns = []
            begin = 1
            for cell in header.split(","):
                columns.append((cell.strip().strip('"'), begin + len(cell) - len(cell.lstrip())))
                begin += len(cell) + 1
        #: Columns without a name behind the last one that has one: spreadsheets leave them behind.
        self._blank = 0
        while len(columns) > 1 and not columns[-1][0]:
            columns.pop()
            self._blank += 1
        self.layout: ColumnLayout = read_layout(columns, name, number, robots)

    @property
    def timed(self) -> bool:
        """True with a column ``t_s``: a trajectory, not a live stream."""
        return self.layout.time is not None

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns as written."""
        return self.layout.names

    @property
    def robots(self) -> tuple[str, ...]:
        """Robots that have columns."""
        return tuple(columns.robot for columns in self.layout.robots)

    def targets(self, line: str, number: int) -> Mapping[str, Target] | None:
        """Targets by robot in the world frame, or None for a comment or blank line.

        Raises:
            BadInputError: this line is wrong; the next one can be read all the same.
        """
        line = line.rstrip("\r\n")
        text = line.lstrip()
        return self.layout.targets(self.row(line, number)) if text and text[0] != "#" else None

    def row(self, given: str | Sequence[float], number: int) -> list[float]:
        """One row in SI, from a line or from numbers in the units of the columns.

        Raises:
            BadInputError: with every finding of this row.
        """
        if not isinstance(given, str):
            values = self._numbers(given, number)
        elif len(given) > MAX_LINE:
            raise BadInputError([Located(self.name, number, 1, _too_long())])
        else:
            values = self._json_values(given, number) if self.is_json else self._csv_values(given, number)
        layout = self.layout
        row = [
            value * factor / divisor
            for value, factor, divisor in zip(values, layout.factors, layout.divisors, strict=True)
        ]
        for columns in layout.robots:
            if columns.direction and math.hypot(*(row[index] for index in columns.direction)) == 0.0:
                index = columns.direction[0]
                message = f"the direction at {layout.names[index]!r} is the zero vector; it needs a length"
                raise BadInputError([Located(self.name, number, self.column(given, index), message)])
            if columns.x_axis and columns.rotation(row) is None:
                index = columns.x_axis[0]
                message = f"the x axis at {layout.names[index]!r} is zero or parallel to the tip's direction"
                raise BadInputError([Located(self.name, number, self.column(given, index), message)])
            try:
                columns.resolve(row)
            except BesideSurfaceError as error:
                at = self.column(given, columns.moving[0])
                raise BadInputError([Located(self.name, number, at, str(error))]) from error
        return row

    def column(self, given: str | Sequence[float], index: int) -> int:
        """Position of the value of column ``index`` in a line, or among numbers, from 1."""
        if not isinstance(given, str):
            return index + 1
        if self.is_json:
            return _key_column(given, self.layout.names[index])
        cells = given.split(",")
        cell = cells[index]
        return sum(len(before) + 1 for before in cells[:index]) + len(cell) - len(cell.lstrip()) + 1

    def _numbers(self, given: Sequence[float], number: int) -> list[float]:
        names = self.layout.names
        if len(given) != len(names):
            message = f"the row has {len(given)} values, the header {len(names)} columns"
            raise BadInputError([Located(self.name, number, 1, message)])
        values = [_as_float(value) for value in given]
        findings = [
            Located(self.name, number, position, message)
            for position, (name, value) in enumerate(zip(names, values, strict=True), 1)
            if (message := _out_of_bounds(name, value, str(value)))
        ]
        if findings:
            raise BadInputError(findings)
        return values

    def _csv_values(self, line: str, number: int) -> list[float]:
        cells = line.split(",")
        names = self.layout.names
        if self._blank and not "".join(cells[len(names) :]).strip():
            del cells[len(names) :]
        if len(cells) != len(names):
            what = f"the row has {len(cells)} values, the header {len(names)} columns"
            column = len(line) + 1
            if len(cells) < len(names):
                what += f"; {names[len(cells)]!r} is the first without one"
            else:
                column = sum(len(cell) + 1 for cell in cells[: len(names)]) + 1
            raise BadInputError([Located(self.name, number, column, what)])
        if '"' in line:
            # Spreadsheets may quote numbers; a comma inside quotes is still a mistake.
            cells = [_unquoted(cell) for cell in cells]
        try:
            values = [float(cell) for cell in cells]
        except ValueError:
            values = []
        if (
            not values
            or not all(map(math.isfinite, values))
            or max(map(abs, values)) > MAX_NUMBER
            or "_" in line
        ):
            findings = []
            for index, (name, cell) in enumerate(zip(names, cells, strict=True)):
                wrong = _not_a_number(name, cell.strip())
                if wrong:
                    findings.append(Located(self.name, number, self.column(line, index), wrong))
            raise BadInputError(findings)
        return values

    def _json_values(self, line: str, number: int) -> list[float]:
        pairs = self._object(line, number)
        names = self.layout.names
        given = dict(pairs)
        findings = [
            Located(self.name, number, _key_column(line, key), f"{key!r} is not in the first row; it must be")
            for key in islice((key for key in given if key not in names), MAX_FINDINGS)
        ]
        values = []
        for name in names:
            if name not in given:
                findings.append(Located(self.name, number, 1, f"{name!r} is missing; the first row has it"))
                continue
            value = given[name]
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                wrong = f"{name}: {json.dumps(value)[:40]} is not a number"
            else:
                value = _as_float(value)
                wrong = _out_of_bounds(name, value, str(value))
                values.append(value)
            if wrong:
                findings.append(Located(self.name, number, _key_column(line, name), wrong))
        if findings:
            raise BadInputError(findings)
        return values

    def _object(self, line: str, number: int) -> list[tuple[str, object]]:
        """Keys and values of one JSON object, duplicates refused."""
        try:
            pairs = _JSON.decode(line.strip())
        except json.JSONDecodeError as error:
            column = error.colno + len(line) - len(line.lstrip())
            raise BadInputError([Located(self.name, number, column, f"not JSON: {error.msg}")]) from error
        except (RecursionError, ValueError) as error:
            message = "not a row: nested too deeply or with numbers too long"
            raise BadInputError([Located(self.name, number, 1, message)]) from error
        if not isinstance(pairs, _Pairs):
            message = 'not a row: a line is one object, {"t_s": ...}'
            raise BadInputError([Located(self.name, number, 1, message)])
        counts = Counter(key for key, _ in pairs)
        if len(counts) < len(pairs):
            twice = [key for key, count in counts.items() if count > 1][:MAX_FINDINGS]
            found = [
                Located(self.name, number, _key_column(line, key, last=True), f"{key!r} is written twice")
                for key in twice
            ]
            raise BadInputError(found)
        return pairs


class _Pairs(list[tuple[str, object]]):
    """Keys and values of a JSON object in order, duplicates included."""


_JSON: Final = json.JSONDecoder(object_pairs_hook=_Pairs)


def _too_long() -> str:
    return f"the line is longer than {MAX_LINE} characters"


def _not_a_number(name: str, cell: str) -> str:
    """The mistake in one cell, "" for none."""
    if not cell:
        return f"{name} is empty; allowed are finite numbers"
    try:
        value = float(cell)
    except ValueError:
        value = None
    if value is None or "_" in cell:
        return f"{name}: {cell[:40]!r} is not a number"
    return _out_of_bounds(name, value, cell)


def _out_of_bounds(name: str, value: float, shown: str) -> str:
    if not math.isfinite(value):
        return f"{name} is {shown[:40]}; allowed are finite numbers"
    return (
        ""
        if abs(value) <= MAX_NUMBER
        else f"{name} is {value:g}; allowed is -{MAX_NUMBER:g} to {MAX_NUMBER:g}"
    )


def _unquoted(cell: str) -> str:
    bare = cell.strip()
    return bare[1:-1] if len(bare) > 1 and bare[0] == bare[-1] == '"' else cell


def _as_float(value: int | float) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _key_column(line: str, key: str, last: bool = False) -> int:
    """Position of a key in a line of JSON, from 1; 1 when it is written with escapes."""
    text = json.dumps(key, ensure_ascii=False)
    return max(line.rfind(text) if last else line.find(text), 0) + 1
