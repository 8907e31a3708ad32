"""Trajectory files: what a row becomes, and what is refused before anything moves."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from contid.errors import BadInputError
from contid.robot_file.load import load_robot_file
from contid.robot_file.robot import RobotDescription
from contid.trajectory.read import MAX_FINDINGS, read_trajectory
from contid.trajectory.rows import RowReader
from contid.trajectory.timed import Trajectory
from contid.units import MAX_LINE


@pytest.fixture
def hand(configs: Path) -> dict[str, RobotDescription]:
    return dict(load_robot_file(configs / "hand.yaml").file.robots)


@pytest.fixture
def finger(configs: Path) -> dict[str, RobotDescription]:
    return dict(load_robot_file(configs / "finger.yaml").file.robots)


def read(text: str, robots: dict[str, RobotDescription]) -> Trajectory:
    return read_trajectory(io.StringIO(text), "t.csv", robots)


def refused(text: str, robots: dict[str, RobotDescription]) -> list[tuple[int, int, str]]:
    with pytest.raises(BadInputError) as caught:
        read(text, robots)
    return [(found.line, found.column, found.message) for found in caught.value.findings]


def test_rows_are_targets_in_si(hand: dict[str, RobotDescription]) -> None:
    header = "t_s,left.x_mm,left.y_mm,right.left_mm,right.right_mm"
    text = f"# a comment\n{header}\n\n0.5, 70,1e1,60,80\n1,71,11,61,81\n"
    trajectory = read(text, hand)
    assert (trajectory.start_s, trajectory.end_s, len(trajectory)) == (0.5, 1.0, 2)
    assert list(trajectory.lines) == [4, 5]
    for early in (-1.0, 0.5):
        targets = trajectory.targets_at(early)
        assert targets["left"].tip_m == (0.07, 0.01, 0.0)
        assert targets["left"].actuation is None
        assert targets["right"].actuation == (0.06, 0.08)
        assert targets["right"].tip_m is None
    assert trajectory.targets_at(7.0)["right"].actuation == (0.061, 0.081)


def test_ndjson_means_the_same_as_csv(hand: dict[str, RobotDescription]) -> None:
    csv = read("t_s,left.x_mm,left.y_mm\n0,50,70\n1,51,72\n", hand)
    ndjson = read(
        '{"t_s": 0, "left.x_mm": 50, "left.y_mm": 70}\n{"left.y_mm": 72, "t_s": 1, "left.x_mm": 51}\n', hand
    )
    for time_s in (0.0, 0.25, 1.0):
        assert csv.targets_at(time_s) == ndjson.targets_at(time_s)


def test_robots_without_columns_are_absent(hand: dict[str, RobotDescription]) -> None:
    assert set(read("t_s,left.x_mm,left.y_mm\n0,50,70\n", hand).targets_at(0.0)) == {"left"}


def test_the_only_robot_needs_no_name(finger: dict[str, RobotDescription]) -> None:
    short = read("t_s,x_mm,y_mm,meas.x_mm,meas.y_mm\n0,50,70,49,69\n", finger)
    long = read("t_s,finger.x_mm,finger.y_mm,finger.meas.x_mm,finger.meas.y_mm\n0,50,70,49,69\n", finger)
    assert short.targets_at(0.0) == long.targets_at(0.0)
    assert short.targets_at(0.0)["finger"].measured_tip_m == (0.049, 0.069, 0.0)


@pytest.mark.parametrize(("wrong", "right"), [("x", "x_mm"), ("left", "left_mm"), ("meas.y", "meas.y_mm")])
def test_a_name_without_its_unit_is_recognised(
    finger: dict[str, RobotDescription], wrong: str, right: str
) -> None:
    ((_, column, message),) = refused(f"t_s,{wrong}\n0,50\n", finger)
    assert column == 5
    assert message.endswith(f"did you mean {right!r}?")


def test_a_measured_direction_becomes_a_unit_vector_or_none(finger: dict[str, RobotDescription]) -> None:
    header = "t_s,x_mm,y_mm,meas.x_mm,meas.y_mm,meas.ax,meas.ay"
    some = read(f"{header}\n0,50,70,49,69,3,4\n1,50,70,49,69,0,0\n", finger)
    assert some.targets_at(0.0)["finger"].measured_direction == (0.6, 0.8, 0.0)
    assert some.targets_at(1.0)["finger"].measured_direction is None


HEADERS = [
    ("t_s,x_mm,y_mm", 5, "write left.x_mm or right.x_mm"),
    ("t_s,left.x_mm", 5, "needs 'left.y_mm'"),
    ("t_s,left.x_mm,left.y_m", 15, "for 'left.y_mm' multiply the numbers by 1000"),
    ("t_s,left.x_mm,left.y_mm,left.x_mm", 25, "repeats column"),
    ("t_s,left.x_mm,left.y_mm,left.z_mm", 25, "unknown column"),
    ("t_s,left.x_mm,left.y_mm,left.left_mm,left.right_mm", 5, "allowed is one of them"),
    ("t_s,left.x_mm,left.y_mm,left.meas.ax,left.meas.ay", 5, "a measured direction, but no measured tip"),
    ("t_s,left.meas.x_mm,left.meas.y_mm", 5, "neither its tip nor its actuation"),
    ("left.x_mm,left.y_mm", 1, "no column 't_s'"),
    ("t_s", 1, "no column moves a robot"),
    ("t_s,left.x_mm,,left.y_mm", 15, "has no name"),
    ("t,left.x,left.y", 1, "did you mean 't_s'?"),
    ("T_S,Left.X_mm,left.y_mm", 1, "did you mean 't_s'?"),
    ("T_S,Left.X_mm,left.y_mm", 5, "did you mean 'left.x_mm'?"),
    ("t,left.x,left.y", 3, "did you mean 'left.x_mm'?"),
    ("0.0,50,70", 1, "the header is missing; the first line names the columns"),
    ("0.0,50,7e1", 8, "the header is missing"),
]


@pytest.mark.parametrize(("header", "column", "expected"), HEADERS)
def test_headers_that_are_refused(
    hand: dict[str, RobotDescription], header: str, column: int, expected: str
) -> None:
    found = refused(f"# first\n{header}\n", hand)
    assert any((line, at) == (2, column) and expected in message for line, at, message in found), found


ROWS = [
    ("0,1,nan", 5, "left.y_mm is nan"),
    ("0,-inf,2", 3, "left.x_mm is -inf"),
    ("0,1", 4, "2 values, the header 3 columns; 'left.y_mm' is the first without one"),
    ("0,1,2,3", 7, "4 values"),
    ("0,,2", 3, "left.x_mm is empty"),
    ("0,1, two", 6, "'two' is not a number"),
    ("0,1_0,2", 3, "not a number"),
    ("-1,1,2", 1, "runs backwards"),
    ("-0.5,1,2", 1, "repeats"),
    ("-0.4999999,1,2", 1, "rows are at least 0.0001 s apart: it is 1e-07 s after -0.5 on line 2"),
    ("-0.49999999999999994,1,2", 1, "time -0.49999999999999994 is too close"),
    ("0," + "1" * MAX_LINE + ",2", 1, "longer than"),
]


@pytest.mark.parametrize(("row", "column", "text"), ROWS, ids=[text for _, _, text in ROWS])
def test_rows_that_are_refused(hand: dict[str, RobotDescription], row: str, column: int, text: str) -> None:
    found = refused(f"t_s,left.x_mm,left.y_mm\n-0.5,50,70\n{row}\n10,50,70\n", hand)
    assert [(line, at) for line, at, _ in found] == [(3, column)]
    assert text in found[0][2]


def test_rows_at_10_khz_are_read_wherever_their_time_begins(hand: dict[str, RobotDescription]) -> None:
    for start in (0.0, 1e6):
        rows = "".join(f"{start + k / 1e4!r},50,70\n" for k in range(200))
        text = io.StringIO(f"t_s,left.x_mm,left.y_mm\n{rows}")
        assert len(read_trajectory(text, "t.csv", hand)) == 200


def test_every_bad_row_is_named_up_to_a_cap(hand: dict[str, RobotDescription]) -> None:
    header = "t_s,left.x_mm,left.y_mm\n"
    assert [line for line, *_ in refused(header + "0,nan,2\n1,1,1\n2,3\n1.5,1,1\n0.5,1,1\n", hand)] == [
        2,
        4,
        6,
    ]
    assert len(refused(header + "x,1,1\n" * 1000, hand)) == MAX_FINDINGS + 1
    assert "empty" in refused("", hand)[0][2]
    assert "no rows" in refused(header, hand)[0][2]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ('{"t_s": 1, "left.x_mm": 50, "left.y_mm": NaN}', "is nan"),
        ('{"t_s": 1, "left.x_mm": 50, "left.y_mm": 1e400}', "is inf"),
        ('{"t_s": 1, "left.x_mm": "50", "left.y_mm": 70}', "not a number"),
        ('{"t_s": 1, "left.x_mm": true, "left.y_mm": 70}', "not a number"),
        ('{"t_s": 1, "left.x_mm": 50}', "'left.y_mm' is missing"),
        ('{"t_s": 1, "left.x_mm": 50, "left.y_mm": 70, "right.x_mm": 1}', "not in the first row"),
        ('{"t_s": 1, "t_s": 2, "left.x_mm": 50, "left.y_mm": 70}', "twice"),
        ('{"t_s": 1, "left.x_mm": 50', "not JSON"),
        ("[1, 50, 70]", "not a row"),
        ("[" * 60000, "not a row"),
        ('{"t_s": ' + "9" * 5000 + "}", "not a row"),
    ],
)
def test_json_rows_that_are_refused(hand: dict[str, RobotDescription], line: str, expected: str) -> None:
    found = refused('{"t_s": 0, "left.x_mm": 50, "left.y_mm": 70}\n' + line + "\n", hand)
    assert found[0][0] == 2
    assert expected in found[0][2]


def test_a_bad_line_of_a_stream_costs_only_itself(hand: dict[str, RobotDescription]) -> None:
    parser = RowReader("left.x_mm,left.y_mm\n", "stdin", hand)
    assert not parser.timed
    assert parser.targets("# nothing\n", 2) is None
    with pytest.raises(BadInputError, match=r"stdin:3:1: left\.x_mm"):
        parser.targets("fifty,70\n", 3)
    targets = parser.targets("50,70\n", 4)
    assert targets is not None
    assert targets["left"].tip_m == (0.05, 0.07, 0.0)
    first = '{"left.x_mm": 50, "left.y_mm": 70}'
    parser = RowReader(first, "stdin", hand)
    assert parser.is_json
    assert parser.targets(first, 1) == targets
