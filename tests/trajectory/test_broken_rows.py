"""Random text: a trajectory is read, or refused with places; nothing else can happen."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from contid.errors import BadInputError, Located
from contid.robot_file.load import load_robot_file
from contid.robot_file.robot import RobotDescription
from contid.trajectory.columns import MAX_FINDINGS
from contid.trajectory.read import read_trajectory
from contid.trajectory.rows import RowReader

CELLS = st.sampled_from(
    ["1", "-2.5", "1e3", "nan", "inf", "", " 7 ", "x", "1_0", "٣", "1e999", "0x10", '"1"', "#"]
)
ROWS = st.lists(st.lists(CELLS, min_size=1, max_size=5).map(",".join), max_size=6)


@pytest.fixture(scope="module")
def hand() -> dict[str, RobotDescription]:
    return dict(load_robot_file(Path(__file__).parent.parent.parent / "configs" / "hand.yaml").file.robots)


@settings(max_examples=75, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rows=ROWS)
def test_rows_of_anything(hand: dict[str, RobotDescription], rows: list[str]) -> None:
    text = "t_s,left.x_mm,left.y_mm\n" + "\n".join(rows)
    found: tuple[Located, ...] = ()
    trajectory = None
    try:
        trajectory = read_trajectory(io.StringIO(text), "t.csv", hand)
    except BadInputError as error:
        found = error.findings
    if trajectory is None:
        assert found
        assert all(1 <= each.line <= len(rows) + 1 for each in found)
    else:
        assert len(trajectory) == sum(1 for row in rows if row.strip() and not row.lstrip().startswith("#"))


@settings(max_examples=75, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=st.text(max_size=200))
def test_any_text(hand: dict[str, RobotDescription], text: str) -> None:
    with pytest.raises(BadInputError) as caught:
        read_trajectory(io.StringIO(text), "t.csv", hand)
    assert caught.value.findings


@pytest.mark.parametrize(
    "text",
    [
        ",".join(f"y_m{number}" for number in range(8000)),
        "x" * 60_000,
        ",".join(["left.x_mm"] * 6000),
        json.dumps({f"y_m{number}": 1 for number in range(5000)}),
        "{" + ", ".join('"x": 1, "y": 2' for _ in range(4000)) + "}",
        '{"left.x_mm": 40, "left.y_mm": 75}\n' + json.dumps({f"y_m{n}": 1 for n in range(5000)}),
    ],
    ids=["names", "one name", "repeated", "keys", "repeated keys", "keys of a row"],
)
def test_the_findings_of_a_line_are_bounded(hand: dict[str, RobotDescription], text: str) -> None:
    """The nearest name is searched for each of them; 60 kB of names took 0.4 s in the daemon."""
    header, _, row = text.partition("\n")
    with pytest.raises(BadInputError) as refused:
        RowReader(header, "t.csv", hand).row(row, 2)
    assert len(refused.value.findings) <= MAX_FINDINGS + 2
