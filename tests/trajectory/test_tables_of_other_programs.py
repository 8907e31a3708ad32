"""Tables as spreadsheets and scripts write them: read where they are clear, refused with the habit's name."""

from __future__ import annotations

import io

import pytest

from contid.errors import BadInputError
from contid.robot_file.load import find_robot_file, load_robot_file
from contid.trajectory.read import read_trajectory
from contid.trajectory.timed import Trajectory

ROBOTS = load_robot_file(find_robot_file("finger")).file.robots
PLAIN = "t_s,x_mm,y_mm\n0,20,80\n1,22.5,80\n"


def read(text: str) -> Trajectory:
    return read_trajectory(io.StringIO(text, newline=None), "rows.csv", ROBOTS)


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + PLAIN,
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace(",", " , "),
        '"t_s","x_mm","y_mm"\n"0","20","80"\n"1", "22.5" ,80\n',
        # numpy.savetxt, and a spreadsheet that once had more columns and rows.
        "# the first experiment\n# t_s,x_mm,y_mm\n0.00e+00,2.00e+01,8.00e+01\n1.00e+00,2.25e+01,8.00e+01\n",
        "t_s,x_mm,y_mm,,\n0,20,80,,\n1,22.5,80,,\n,,,,\n",
    ],
)
def test_the_same_rows_in_other_clothes(text: str) -> None:
    assert (read(text).rows == read(PLAIN).rows).all()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (PLAIN.replace(",", ";"), "rows.csv:1:1: .*commas, not by semicolons"),
        (PLAIN.replace(",", "\t"), "rows.csv:1:1: .*commas, not by semicolons or tabs"),
        ("# made by hand\n0,20,80\n", "rows.csv:2:1: unknown column '0' .*the header is missing"),
        ("# t_s,x_mm,z_mm\n0,20,80\n", "rows.csv:1:12: unknown column 'z_mm'"),
        ("t_s,x_mm,,y_mm\n0,20,,80\n", "rows.csv:1:10: a column has no name"),
        ("t_s,x_mm,y_mm,\n0,20,80,5\n", "rows.csv:2:9: the row has 4 values, the header 3 columns"),
        (
            "t_ms,x_mm,y_mm\n0,20,80\n",
            r"rows.csv:1:1: .* for 't_s' multiply the numbers by 0.001 \(ms to s\)",
        ),
        ("t_s,x_m,y_mm\n0,20,80\n", r"rows.csv:1:5: .* for 'x_mm' multiply the numbers by 1000 \(m to mm\)"),
        ("\ufffd\ufffdt\0_\0s\0\n", "UTF-8"),
        ('t_s,x_mm,y_mm\n0,"1,020"\n', "rows.csv:2:3: x_mm: .* is not a number"),
        ("t_s,x_mm,y_mm\n0,1e308,80\n", "rows.csv:2:3: x_mm is 1e.308; allowed is -1e.10 to 1e.10"),
        ('{"t_s":0,"x_mm":1e200,"y_mm":80}\n', "x_mm is 1e.200; allowed is"),
        ("t_s,x_mm,y_mm\n0," + "9" * 5000 + ",80\n", r"x_mm is 9{40}; allowed are finite numbers$"),
    ],
)
def test_the_habit_is_named(text: str, expected: str) -> None:
    with pytest.raises(BadInputError, match=expected):
        read(text)


def test_the_table_of_another_program_has_one_message_and_the_command_that_reads_it() -> None:
    with pytest.raises(BadInputError) as refused:
        read("Frame,Time,X,Y,Z,QX\n0,0,1,2,3,4\n")
    assert len(refused.value.findings) == 1
    assert "6 columns are unknown: contid adapt FILE --for ROBOT" in str(refused.value)


@pytest.mark.parametrize("text", [
    "LabVIEW Measurement\t\nSeparator\tTab\n", "t:0,x:1.5,y:2\nt:1,x:1.5,y:3\n", ",x,y\n2024-05-01,1,2\n",
    "PK\3\4\n",
])  # fmt: skip
def test_a_table_without_a_column_of_the_robot_has_the_command_that_reads_it(text: str) -> None:
    with pytest.raises(BadInputError, match="unknown: contid adapt FILE --for ROBOT reads") as refused:
        read(text)
    assert str(refused.value).count("contid adapt FILE") == 1
