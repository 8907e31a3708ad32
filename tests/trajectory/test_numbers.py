"""Rows of numbers are read like the same rows as text."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from contid.errors import BadInputError
from contid.robot_file.load import load_robot_file
from contid.robot_file.robot import RobotDescription
from contid.trajectory.read import read_trajectory, trajectory_of_rows
from contid.trajectory.rows import RowReader

HEADER = "t_s,x_mm,y_mm"
numbers = st.floats(-1e10, 1e10)


@pytest.fixture
def finger(configs: Path) -> dict[str, RobotDescription]:
    return dict(load_robot_file(configs / "finger.yaml").file.robots)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=20))
def test_numbers_and_their_text_give_the_same_trajectory(
    finger: dict[str, RobotDescription], points: list[tuple[float, float]]
) -> None:
    rows = [(float(number), *point) for number, point in enumerate(points)]
    text = "\n".join([HEADER, *(",".join(map(repr, row)) for row in rows)])
    expected = read_trajectory(io.StringIO(text), "rows", finger)
    found = trajectory_of_rows(RowReader(HEADER, "rows", finger), rows)
    assert np.array_equal(found.rows, expected.rows)
    assert list(found.lines) == list(expected.lines)
    reader = RowReader("x_mm,y_mm", "rows", finger)
    for row in rows:
        assert reader.row(row[1:], 1) == reader.row(",".join(map(repr, row[1:])), 1)


@pytest.mark.parametrize(
    ("row", "place", "message"),
    [
        ((1.0, 2.0), 1, "the row has 2 values, the header 3 columns"),
        ((1.0, math.nan, 3.0), 2, "x_mm is nan; allowed are finite numbers"),
        ((1.0, 2.0, 10**400), 3, "y_mm is inf; allowed are finite numbers"),
        ((1.0, 2.0, -2e10), 3, "y_mm is -2e+10; allowed is -1e+10 to 1e+10"),
        ((0.0, 2.0, 3.0), 1, "time repeats: 0.0 after 0.0 on line 2"),
    ],
    ids=["short", "nan", "huge", "far", "time"],
)
def test_a_wrong_row_is_located(
    finger: dict[str, RobotDescription], row: tuple[float, ...], place: int, message: str
) -> None:
    with pytest.raises(BadInputError) as caught:
        trajectory_of_rows(RowReader(HEADER, "rows", finger), [(0.0, 50.0, 75.0), row])
    assert [(f.line, f.column, f.message) for f in caught.value.findings] == [(3, place, message)]
