"""Twelve mutations of a table in four dialects: each is refused, and the table itself is taken."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from contid.errors import ContidError
from contid_adapt.adapt import adapt

T = np.arange(300) / 100.0
X = 20.0 + 5.0 * np.sin(np.pi / 2 * T) ** 2
Y = 80.0 + 3.0 * (1.0 - np.cos(np.pi / 2 * T))


@dataclass(frozen=True)
class Dialect:
    """How a table is written: lines above its names, signs, units of time and places."""

    above: str
    names: str
    separator: str
    decimal: str
    per_s: float
    per_mm: float

    def cells(self) -> list[list[str]]:
        turn = (0 * T + 1, 0 * T, 0 * T, 0 * T)
        columns = (T * self.per_s, X * self.per_mm, Y * self.per_mm, *turn)
        return [
            [f"{value:.9g}".replace(".", self.decimal) for value in row] for row in np.column_stack(columns)
        ]

    def text(self, cells: list[list[str]], names: str = "") -> str:
        rows = "\n".join(self.separator.join(row) for row in cells)
        return f"{self.above}{(names or self.names).replace(' ', self.separator)}\n{rows}\n"

    def mapping(self, places: str = "x, y", time: float = 1.0) -> str:
        factor = f"{1 / self.per_mm:g}*"
        x, y = (
            f"-{factor}{each[1:]}" if each[0] == "-" else f"{factor}{each}" for each in places.split(", ")
        )
        turn = "quaternion_wxyz: [qw, qx, qy, qz, z]"
        return f"t_s: {time / self.per_s:g}*t\nx_mm, y_mm: [{x}, {y}]\n{turn}\nframe: robot\n"


DIALECTS = {
    "comma": Dialect("", "t x y qw qx qy qz", ",", ".", 1.0, 1.0),
    "semicolon, decimal comma, metres": Dialect("sep=;\n", "t x y qw qx qy qz", ";", ",", 1e3, 1e-3),
    "tabs behind facts, nanoseconds": Dialect("RATE\t100\n", "t x y qw qx qy qz", "\t", ".", 1e9, 1.0),
    "blanks behind a comment": Dialect("# a robot\n# ", "t x y qw qx qy qz", " ", ".", 1.0, 1e-3),
}


def refused(dialect: Dialect, kind: str) -> tuple[str, str]:
    """The text and the mapping of a mutation."""
    cells, mapping, names = dialect.cells(), dialect.mapping(), ""
    other = {",": ";", ";": "\t", "\t": ";", " ": ";"}[dialect.separator]
    if kind == "unit":
        mapping = replace(dialect, per_mm=dialect.per_mm * 1e3).mapping()
    elif kind == "column":
        mapping = dialect.mapping("y, x")
    elif kind == "sign":
        mapping = dialect.mapping("-x, y")
    elif kind == "time":
        mapping = dialect.mapping(time=1e3)
    elif kind == "decimal sign":
        cells[7][1] = cells[7][1].replace(dialect.decimal, "." if dialect.decimal == "," else ",")
    elif kind == "header shifted":
        names = "n " + dialect.names
    elif kind == "truncated":
        return dialect.text(cells)[:-9], mapping
    elif kind == "mixed separators":
        text = dialect.text(cells).split("\n")
        text[20] = text[20].replace(dialect.separator, other)
        return "\n".join(text), mapping
    elif kind == "names twice":
        names = dialect.names.replace("y", "x", 1)
    elif kind == "quaternion":
        for row in cells[9:]:
            row[3] = "1" + dialect.decimal + "3"
    elif kind == "header again":
        return dialect.text(cells) + dialect.text(cells), mapping
    elif kind == "time again":
        cells += cells
    return dialect.text(cells, names), mapping


KINDS = ("unit", "column", "sign", "time", "decimal sign", "header shifted", "truncated", "mixed separators",
         "names twice", "quaternion", "header again", "time again")  # fmt: skip


@pytest.mark.parametrize("dialect", DIALECTS.values(), ids=DIALECTS)
def test_a_table_is_taken_and_none_of_its_mutations(dialect: Dialect, tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text(dialect.text(dialect.cells()))
    found = adapt(path, "finger", dialect.mapping())
    np.testing.assert_allclose(found.rows[:, :3], np.column_stack([T, X, Y]), atol=2e-6)
    taken = []
    for kind in KINDS:
        text, mapping = refused(dialect, kind)
        path.write_text(text)
        with contextlib.suppress(ContidError):
            adapt(path, "finger", mapping)
            taken.append(kind)
    assert not taken
