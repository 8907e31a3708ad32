"""Small tables as instruments, spreadsheets and programs of a lab write them, each read without help."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contid.errors import BadInputError, ContidError
from contid_adapt.known import propose
from contid_adapt.meaning.expression import numbers_of
from contid_adapt.reading.lines import TextLines, lines_of
from contid_adapt.reading.read import read_table

#: ni.com, "Specification for the LabVIEW Measurement File"; a column of comments stands in the header alone.
LVM = (
    "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tOne\nTime\t10:00:00.12\n"
    "***End_of_Header***\t\n\t\nChannels\t2\t\t\nSamples\t3\t3\t\nX_Dimension\tTime\tTime\t\n"
    "X0\t0.0E+0\t0.0E+0\t\nDelta_X\t0.010000\t0.010000\t\n***End_of_Header***\t\t\t\nX_Value\tx\ty\tComment\n"
    "{}0.00\t1.5\t2\n0.01\t1.5\t3\n0.02\t1.5\t4\n"
)
#: Nexus writes every kind of output into one file, at its own rate.
NEXUS = (
    "Devices\n1000\n,,Cell - Force\nFrame,Sub Frame,Fz\n,,N\n1,0,0.5\n1,1,0.6\n1,2,0.7\n1,3,0.6\n1,4,0.5\n\n"
    "Trajectories\n100\n,,S:TIP,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,1.5,2,3\n2,0,1.5,3,3\n3,0,1.5,4,3\n"
)
NS = 1_714_557_600 * 10**9
TEXTS: dict[str, tuple[str, dict[str, list[Any]]]] = {
    "labview": (LVM.format(""), {"X_Value": [0, 0.01, 0.02], "y": [2, 3, 4]}),
    "labview, a comment in the middle": (
        LVM.format("").replace("\t3\n0.02", "\t3\tpump on\n0.02"),
        {"X_Value": [0, 0.01, 0.02], "y": [2, 3, 4]},
    ),
    "labview, comments in the first rows": (
        LVM.format("").replace("\t2\n0.01\t1.5\t3\n", "\t2\t17\n0.01\t1.5\t3\tpump\ton\n"),
        {"X_Value": [0, 0.01, 0.02], "y": [2, 3, 4]},
    ),
    "labview, a comment in every row": (
        "".join(
            f"{line}\tok\n" if line.startswith("0.0") else f"{line}\n"
            for line in LVM.format("").splitlines()
        ),
        {"X_Value": [0, 0.01, 0.02], "y": [2, 3, 4]},
    ),
    "nexus, devices and trajectories": (NEXUS, {"Frame": [1, 2, 3], "S_TIP.Y": [2, 3, 4]}),
    "motive with numbers of bodies": (
        ",,Rigid Body,Rigid Body,Rigid Body\n,,Tip,Tip,Tip\n,,1,1,1\n,,Position,Position,Position\n"
        "Frame,Time,X,Y,Z\n0,0.0,1,2,3\n1,0.01,1,2,3\n2,0.02,1,2,3\n3,0.03,1,2,3\n",
        {"Time": [0, 0.01, 0.02, 0.03], "Tip.Position.Y": [2, 2, 2, 2]},
    ),
    "pandas, two levels with names": (
        "body,tip,tip\naxis,x,y\nt,,\n0.0,1.5,2\n0.1,1.5,3\n",
        {"t": [0, 0.1], "tip.x": [1.5, 1.5], "tip.y": [2, 3]},
    ),
    "pandas, dates": (
        "timestamp,x\n2024-05-01 10:00:00.000000,1\n2024-05-01 10:00:00.010000,2\n",
        {"timestamp": [NS, NS + 10**7], "x": [1, 2]},
    ),
    "dates of another zone, the first sample lost": (
        "time,x,y\n2024-05-01T12:00:00+02:00,NaN,\n2024-05-01T12:00:00.5+02:00,2,3\n"
        "2024-05-01T12:00:01+02:00,2,4\n",
        {"time": [NS, NS + 5 * 10**8, NS + 10**9], "x": [None, 2, 2]},
    ),
    "matlab, dates": ("Time,x\n01-May-2024 10:00:00,1\n01-May-2024 10:00:01,2\n", {"Time": [NS, NS + 10**9]}),
    "matlab, durations": ("Time,x\n0 sec,1\n0.01 sec,2\n0.02 sec,3\n", {"Time": [0, 10**7, 2 * 10**7]}),
    "a spreadsheet, dates": (
        "Zeit;x\n01.05.2024 10:00:00,5;1,5\n01.05.2024 10:00:01;2,5\n",
        {"Zeit": [NS + 5 * 10**8, NS + 10**9], "x": [1.5, 2.5]},
    ),
    "times of day past midnight": (
        "t,x\n23:59:59.5,1\n00:00:00.5,2\n",
        {"t": [86_399_500_000_000, 86_400_500_000_000]},
    ),
    "minutes and seconds": ("t,x\n00:59.5,1\n01:00.5,2\n", {"t": [59_500_000_000, 60_500_000_000]}),
    "influx": (
        "#group,false,false\n#datatype,dateTime:RFC3339,double\n,_time,x\n"
        ",2024-05-01T10:00:00Z,1.5\n,2024-05-01T10:00:01Z,2\n",
        {"time": [NS, NS + 10**9], "x": [1.5, 2]},
    ),
    "serial plotter": ("8.2,y:3\nt:0,x:1.5,y:2\nt:10,x:1.5,y:3\nt:20,x:1.5,y:-4e-1\n", {
        "t": [0, 10, 20], "y": [2, 3, -0.4]
    }),
    "serial plotter behind messages of a board": (
        "rst:0x1 (POWERON)\nready\n" + "".join(f"millis: {10 * k} x: 1.5 y: {k}\n" for k in range(9)),
        {"millis": [10 * k for k in range(9)], "y": [*range(9)]},
    ),
    "serial monitor": (
        "10:00:00.000 -> 1.5\t2\n10:00:00.010 -> 1.5\t3\n10:00:00.020 -> 1.5\t4\n",
        {"c1": [36_000 * 10**9 + k * 10**7 for k in range(3)], "c4": [2, 3, 4]},
    ),
    "names behind a sign, in blanks above tabs": ("# s X Y time\n1\t2\t3\t0.1\n1\t2\t4\t0.2\n", {
        "Y": [3, 4], "time": [0.1, 0.2]
    }),
    "comsol": (
        "% Model:   a.mph\n% Time (s)      X (mm)     Y (mm)\n0.0   1.5   2\n0.1   1.5   3\n0.2   1.5   4\n",
        {"Time": [0, 0.1, 0.2], "Y": [2, 3, 4]},
    ),
    "psql": ("  t  |  x  \n-----+-----\n 0.0 | 1.5\n 0.1 | 2.5\n(2 rows)\n", {"t": [0, 0.1]}),
    "decimal commas in quotes": ('t,x\n"0,01","20,5"\n"0,02","21"\n', {"t": [0.01, 0.02], "x": [20.5, 21]}),
}  # fmt: skip


@pytest.mark.parametrize(("text", "columns"), TEXTS.values(), ids=TEXTS)
def test_a_table_is_read_as_its_program_means_it(
    text: str, columns: dict[str, list[Any]], tmp_path: Path
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    table = read_table(path)
    for name, values in columns.items():
        found = table.column(name).values
        assert [None if each != each else each for each in found.tolist()] == values, (name, table.columns)


@pytest.mark.parametrize(("text", "line"), [
    ("Time,x\n0 sec,1\n0.01 sec,2\n", "t_s: 1e-09*Time"),
    ("Zeit [s];Weg x [mm]\n0,0;1,5\n0,1;2,5\n", "t_s: Zeit"),
    (LVM.format(""), "rate_hz, rows per second (the file states Delta_X 100)"),
])  # fmt: skip
def test_a_stated_unit_or_rate_of_time_is_proposed(text: str, line: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    assert line in propose(read_table(path), "finger").report(read_table(path))


@pytest.mark.parametrize(("text", "message"), [
    ('t,x\n"900","20"\n"1,000","21"\n', r":3:1: '1,000': is its comma a decimal sign, or one of thousands\?"),
    ("x,y\n1,2\n1\n1,3\n", r":3:1: the row has 1 cells, the others have 2"),
    ("x,y\n1,2\n1,3\n1", r":4:1: the row has 1 cells, .* the file ends within a row"),
])  # fmt: skip
def test_an_ambiguous_or_broken_table_is_refused_in_its_place(
    text: str, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(BadInputError, match=message):
        read_table(path)


def test_a_damaged_time_is_refused_in_its_place(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    lines = [f"2024-05-01 10:00:0{k},{k}" for k in range(9)]
    path.write_text("\n".join(["t,x", *lines]).replace("00:05", "0x:05") + "\n")
    with pytest.raises(BadInputError, match=r":7:1: t: '2024-05-01 10:0x:05' is not a number"):
        numbers_of(read_table(path), "t")


def test_a_text_that_loses_its_line_ends_has_no_footer(tmp_path: Path) -> None:
    """Behind a byte that is missing UTF-16 is one long line of other letters."""
    path = tmp_path / "a.txt"
    text = "t\tx\n" + "".join(f"{k}\t1.5\n" for k in range(99))
    data = bytearray(text.encode("utf-16"))
    del data[400]
    path.write_bytes(data)
    with pytest.raises(BadInputError, match="the row has 1 cells, the others have 2"):
        read_table(path)


@pytest.mark.parametrize(("begin", "message"), [
    (b"\x02P\x02\x00\x00", "a C3D file"), (b"TDSm\x0e\0\0\0", "a TDMS file"), (b"\x80\x04\x95", "a pickle"),
])  # fmt: skip
def test_a_format_that_is_not_read_is_named(begin: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(begin + bytes(range(200)))
    with pytest.raises(ContidError, match=message):
        read_table(path)


def test_dates_of_arrays_and_records(tmp_path: Path) -> None:
    when = np.array(["2024-05-01T10:00:00.25", "2024-05-01T10:00:01"], dtype="datetime64[ms]")
    np.savez(tmp_path / "a.npz", when=when, record=np.array([(1.5, 2), (2.5, 3)], [("x", "f4"), ("n", "i4")]))
    table = read_table(tmp_path / "a.npz")
    assert table.column("when").values.tolist() == [NS + 250_000_000, NS + 10**9]
    assert table.column("record.x").values.tolist() == [1.5, 2.5]


@pytest.mark.parametrize("form", ["parquet", "feather"])
def test_dates_of_arrow(form: str, tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow", reason="pip install pyarrow")
    from pyarrow import feather, parquet

    when = pa.array([NS // 1000, NS // 1000 + 1], pa.timestamp("us"))
    table = pa.table({"when": when, "tip": [[1.5, 2.0], [1.5, 3.0]], "x": pa.array([1, None], pa.float64())})
    write = {"parquet": parquet.write_table, "feather": feather.write_feather}[form]
    write(table, str(tmp_path / "a"))
    found = read_table(tmp_path / "a")
    assert found.column("when").values.tolist() == [NS, NS + 1000]
    assert found.column("tip[1]").values.tolist() == [2, 3]
    assert np.isnan(found.column("x").values).tolist() == [False, True]


def test_lines_of_bytes_are_those_of_the_text() -> None:
    text = 'a;ä\n"\n";2\n\n€;3\nlast;\n;;\n'
    joined = ["a;ä", '" ";2', "", "", "€;3", "last;"]
    lines = lines_of(text.encode())
    assert isinstance(lines, TextLines)
    assert [*lines] == joined
    assert [lines[k] for k in range(-len(lines), len(lines))] == 2 * joined
    assert lines[1:9] == joined[1:]
    assert lines[::-2] == joined[::-2]
    with pytest.raises(IndexError):
        lines[6]
