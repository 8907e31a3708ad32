"""A common trajectory is cut by node; what has no node or no time is named with its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from contid.errors import ContidError
from contid_fleet.common_trajectory import read_common_trajectory


def read(folder: Path, text: str) -> dict[str, tuple[tuple[str, ...], list[list[float]]]]:
    path = folder / "t.csv"
    path.write_text(text)
    return {
        name: (part.columns, [*map(list, part.rows)]) for name, part in read_common_trajectory(path).items()
    }


def test_columns_go_to_their_nodes(tmp_path: Path) -> None:
    found = read(tmp_path, "# two\nb/l.x_mm,t_s,a/x_mm,b/r.x_mm\n1,0,2,3\n4,0.5,5,6\n")
    assert found == {
        "a": (("t_s", "x_mm"), [[0.0, 2.0], [0.5, 5.0]]),
        "b": (("t_s", "l.x_mm", "r.x_mm"), [[0.0, 1.0, 3.0], [0.5, 4.0, 6.0]]),
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t_s,x_mm\n0,1\n", r"t\.csv:1:1: column 'x_mm': t_s or NODE/COLUMN"),
        ("a/x_mm\n1\n", "no column t_s"),
        ("t_s\n1\n", "no column of a node"),
        ("t_s,a/x_mm,a/x_mm\n0,1,1\n", "is there twice"),
        ("t_s,a/t_s\n0,1\n", "a/t_s"),
        ("t_s,A/x_mm\n0,1\n", "A/x_mm"),
        ("t_s,who/x_mm\n0,1\n", "who/x_mm"),
        ("t_s,a/x_mm\n0,1\n1\n", r"t\.csv:3:1: the row has 1 values"),
        ("t_s,a/x_mm\n0,b\n", r"t\.csv:2:3: a/x_mm: 'b' is not a finite number"),
        ("t_s,a/x_mm\n", r"t\.csv:1:1: no rows after the header"),
        ("", "empty"),
    ],
)
def test_what_is_no_common_trajectory_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ContidError, match=message):
        read(tmp_path, text)


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ContidError, match="cannot read it"):
        read_common_trajectory(tmp_path / "none.csv")
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe")
    with pytest.raises(ContidError, match="UTF-8"):
        read_common_trajectory(tmp_path / "b.csv")
