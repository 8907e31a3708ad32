"""Arguments of `contid move`."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest

from contid.errors import ContidError
from contid.remote.client.move_arguments import columns_and_rows, point


def test_text_becomes_points_and_rows() -> None:
    assert point(["left", "x_mm=40", "y_mm=75"]) == {"left.x_mm": 40.0, "left.y_mm": 75.0}
    assert point(["x_mm=4e1"]) == {"x_mm": 40.0}
    for wrong, message in (
        (["x_mm=far"], "a finite number is expected"),
        (["x_mm=nan"], "a finite number is expected"),
        (["left"], "no COLUMN=VALUE"),
        (["x_mm=1", "y_mm"], "a finite number is expected"),
        (["left", "x_mm=1", "x_mm=2"], "x_mm is given twice"),
    ):
        with pytest.raises(ContidError, match=message):
            point(wrong)
    columns, rows = columns_and_rows(["# a circle\n", "t_s,x_mm\n", "0,1\n", "\n", "1,2\n"])
    assert (columns, list(rows)) == (["t_s", "x_mm"], [[0.0, 1.0], [1.0, 2.0]])


@pytest.mark.parametrize(
    ("row", "place"),
    [
        ("0,one", "2:3: y_mm: 'one'"),
        ("0, nan", "2:3: y_mm: 'nan'"),
        ("inf,0", "2:1: x_mm"),
        ("1", "2:1: the row"),
    ],
)
def test_a_mistake_in_rows_is_named_with_file_line_and_column(row: str, place: str, tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    path.write_text(f"x_mm,y_mm\n{row}\n")
    with path.open() as file, pytest.raises(ContidError, match=re.escape(f"{path}:{place}")):
        list(columns_and_rows(file)[1])


@pytest.mark.parametrize(
    ("header", "message", "named"),
    [
        ("t_s,x_mm", "rows:3:1: too far\nrows:2:1: on line 3", "{path}:5:1: too far\n{path}:3:1: on line 5"),
        ("x_mm,y_mm", "rows:2: too far", "{path}:5: too far"),
        ("x_mm,y_mm", "another client took rows:2 over", "another client took rows:2 over"),
        ("x_mm,y_mm", "rows:9: a row that is none of these", "{path}:9: a row that is none of these"),
    ],
)
def test_what_the_daemon_finds_is_named_with_file_and_line(
    header: str, message: str, named: str, tmp_path: Path
) -> None:
    path = tmp_path / "rows.csv"
    path.write_text(f"# a circle\n{header}\n0,1\n\n1,2\n")
    with path.open() as file:
        _, rows = columns_and_rows(file)
        assert list(rows) == [[0.0, 1.0], [1.0, 2.0]]
    assert rows.located(message) == named.format(path=path)


def test_a_header_without_rows_is_no_move() -> None:
    """`contid move` ended with exit code 0, and nothing had moved."""
    _, rows = columns_and_rows(io.StringIO("x_mm,y_mm\n\n"))
    with pytest.raises(ContidError, match="trajectory:1:1: no rows after the header"):
        list(rows)


def test_a_live_row_that_is_cut_off_is_not_followed() -> None:
    """As of `contid run`: a killed producer may leave ``50,7`` of ``50,75``."""
    text = io.StringIO("x_mm,y_mm\n50,75\n50,7")
    text.name = "<stdin>"  # as click.File has it
    _, rows = columns_and_rows(text)
    assert next(rows) == [50.0, 75.0]
    with pytest.raises(ContidError, match="stdin:3:1: the last row has no end of line"):
        next(rows)
