"""Small files in the dialects of trackers, robots and programs, as manuals and public exports have them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contid.errors import BadInputError
from contid_adapt.reading.read import read_table

#: docs.optitrack.com, "Data Export: CSV"; headers of public takes.
MOTIVE = (
    "Format Version,1.23,Take Name,a,Capture Frame Rate,120.000000,Total Exported Frames,3,"
    "Length Units,Meters\n\n"
    ",,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body\n"
    ",,Tip,Tip,Tip,Tip,Tip,Tip,Tip,Tip\n" + ",," + ",".join(["9F0011223344"] * 8) + "\n"
    ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error\n"
    "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,\n"
    "0,0.0,0,0,0,1,0.1,0.2,0.3,0.0001\n1,0.01,0,0,0,1,0.1,0.2,0.3,0.0001\n2,0.02,,,,,,,,\n"
)
QTM = (
    "NO_OF_FRAMES\t2\nNO_OF_MARKERS\t2\nFREQUENCY\t100\nTIME_STAMP\t2020-01-01, 10:00:00\n"
    "MARKER_NAMES\ttip\tbase\n{}1\t0.00\t1\t2\t3\t4\t5\t6\n2\t0.01\t1\t2\t3\t4\t5\t6\n"
)
CASES: dict[str, tuple[str, dict[str, list[Any]]]] = {
    "motive": (
        MOTIVE,
        {"Time": [0.0, 0.01, 0.02], "Tip.Position.Z": [0.3, 0.3, None], "Tip.Rotation.W": [1, 1, None]},
    ),
    "vicon": (
        "Trajectories\n100\n,,S:TIP,,,S:BASE,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,,mm,mm,mm,mm,mm,mm\n"
        "1,0,1.5,2,3,4,5,6\n2,0,1.5,2,3,4,5,6\n",
        {"S_TIP.X": [1.5, 1.5], "S_BASE.Z": [6.0, 6.0]},
    ),
    "vicon, filled to the width of the rows": (
        "Trajectories,,,,,,,\n100,,,,,,,\n,,S:TIP,,,S:BASE,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n"
        ",,mm,mm,mm,mm,mm,mm\n1,0,1.5,2,3,4,5,6\n2,0,1.5,2,3,4,5,6\n",
        {"Frame": [1, 2], "S_TIP.X": [1.5, 1.5], "S_BASE.Z": [6.0, 6.0]},
    ),
    "trc": (
        "PathFileType,4,(X/Y/Z),a.trc,,,,\nDataRate,CameraRate,NumFrames,NumMarkers,Units,OrigDataRate,,\n"
        "100,100,2,2,mm,100,,\nFrame#,Time,TIP,,,BASE,,\n,,X1,Y1,Z1,X2,Y2,Z2\n,,,,,,,\n"
        "1,0,1.5,2,3,4,5,6\n2,0.01,1.5,2,3,4,5,6\n",
        {"Time": [0, 0.01], "TIP.X1": [1.5, 1.5], "BASE.Z2": [6.0, 6.0]},
    ),
    "numbers above the names": (
        "Log started\nlength,count,a,b\n0.022,7,13,5\nTime,x0,y0,x1,y1\n0,1,2,3,4\n1,1,2,3,5\n",
        {"Time": [0, 1], "y1": [4, 5]},
    ),
    "two separators behind": (
        "t,x (mm),y (mm)\n0,1,2,,\n1,2,3,,\n",
        {"t": [0, 1], "x": [1, 2], "y": [2, 3]},
    ),
    "a quoted cell over two lines where a sample was lost": (
        '0.1,1,2\r\n0.2,"\r\n"\r\n0.3,3,4\r\n0.4,3,5\r\n',
        {"c1": [0.1, 0.3, 0.4], "c3": [2, 4, 5]},
    ),
    "a line of blanks above": ("Client\n \nopen\na 1 2 3\na 2 2 3\n", {"c2": [1, 2], "c4": [3, 3]}),
    "qtm": (
        QTM.format("Frame\tTime\ttip X\ttip Y\ttip Z\tbase X\tbase Y\tbase Z\n"),
        {"tip_X": [1, 1], "base_Z": [6, 6]},
    ),
    "qtm without names": (QTM.format(""), {"Time": [0, 0.01], "tip_X": [1, 1], "base_Z": [6, 6]}),
    "euroc": (
        "#timestamp [ns], p_RS_R_x [m], q_RS_w []\n"
        "1403636580838555648,4.6,0.5\n1403636580843555328,4.7,0.6\n",
        {"timestamp": [1403636580838555648, 1403636580843555328], "p_RS_R_x": [4.6, 4.7]},
    ),
    "rostopic -p": (
        "%time,field.header.seq,field.header.frame_id,field.pose.position.x\n"
        "1464265231000000001,1,map,0.1\n1464265232000000001,2,map,0.2\n",
        {"time": [1464265231000000001, 1464265232000000001], "field.pose.position.x": [0.1, 0.2]},
    ),
    "tum": (
        "# ground truth trajectory\n# timestamp tx ty\n1311868163.8696 -0.2 0.1\n1311868163.8796 -0.2 0.1\n",
        {"timestamp": [1311868163.8696, 1311868163.8796], "ty": [0.1, 0.1]},
    ),
    "savetxt": ("# t_s,x_mm\n0.000e+00,2.0e+01\n1.0e+00,2.1e+01\n", {"t_s": [0, 1], "x_mm": [20, 21]}),
    "no names": ("0 1 2\n1 2 3\n", {"c1": [0, 1], "c3": [2, 3]}),
    "decimal comma": ("sep=;\nt;x;y\n0,0;1,5;2\n0,1;1,5;2\n", {"t": [0.0, 0.1], "x": [1.5, 1.5]}),
    "decimal comma, tabs": ("t\tx\n0,01\t1,5e-3\n0,02\t1,5\n", {"t": [0.01, 0.02], "x": [0.0015, 1.5]}),
    "pandas index": (",t,x\n0,0.0,1.5\n1,0.1,1.6\n", {"t": [0.0, 0.1], "x": [1.5, 1.6], "c1": [0, 1]}),
    "one name fewer": ("t x y\n1 0.0 1.5 2\n2 0.1 1.6 2\n", {"t": [0.0, 0.1], "y": [2, 2]}),
    "separator behind": ("t,x\n0,1,\n1,2,\n", {"t": [0, 1], "x": [1, 2]}),
    "lists in cells": (
        't,y\n0.1,"[1e-4, 2, 3]"\n0.2,"[1e-4, 2, 4]"\n',
        {"y[0]": [1e-4, 1e-4], "y[2]": [3, 4]},
    ),
    "tuples in cells": ("t;p\n0.1;(1.0, 2.0)\n0.2;(1.0, 2.5)\n", {"t": [0.1, 0.2], "p[1]": [2.0, 2.5]}),
    "turned": (
        "t," + ",".join(map(str, range(30))) + "\nx [mm]," + ",".join(["7"] * 30) + "\n",
        {"x": [7.0] * 30},
    ),
    "ndjson": (
        '{"t":1,"pose":{"x":1}, "s":[1,2]}\n{"t":2,"pose":{"x":3},"s":[1,4]}\n',
        {"pose.x": [1, 3], "s[1]": [2, 4]},
    ),
    "json of lists": ('{"t": [0, 1], "p": [[1, 2], [3, 4]]}', {"t": [0, 1], "p[1]": [2, 4]}),
    "json of objects whose keys have another order": (
        '{\n"t": {"0": 0, "1": 1},\n"x": {"1": 20, "0": 10}\n}',
        {"t": [0, 1], "x": [10, 20]},
    ),
    "cr cr lf": ("t,x\r\r\n0,1\r\r\n1,2\r\r\n", {"t": [0, 1], "x": [1, 2]}),
    "bars": ("| t | x |\n|---|---|\n| 0 | 1 |\n| 1 | 2 |\n", {"t": [0, 1], "x": [1, 2]}),
    "unit line": ("t,x\ns,mm\n0,1\n1,2\n", {"t": [0, 1], "x": [1, 2]}),
    "quoted": ('"t","x"\n"0","1"\n"1","2"\n', {"t": [0, 1], "x": [1, 2]}),
    "empty behind": ("t_s,x_mm,,\n0,20,,\n1,21,,\n,,,\n", {"t_s": [0, 1], "x_mm": [20, 21]}),
    "two sessions": ("t,x\n0,1\n1,2\nt,x\n0,3\n1,4\n", {"x": [1, 2, 3, 4]}),
    "NDI": (
        "Tools,Port 1: 8700339,Frame,State,Q0,Tx\n"
        "1,Port1,100,OK,1,10\n1,Port1,101,Missing,,\n1,Port1,102,OK,1,11\n",
        {"Tx": [10, None, 11], "Frame": [100, 101, 102]},
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_dialect_is_read(name: str, tmp_path: Path) -> None:
    text, required = CASES[name]
    path = tmp_path / "a.csv"
    path.write_bytes(text.encode())
    table = read_table(path)
    for column, values in required.items():
        want = np.array([np.nan if each is None else each for each in values])
        np.testing.assert_array_equal(table.column(column).values, want)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "latin-1"])
def test_an_encoding_is_read(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes("t,h\u00f6he\n0,1\n1,2\n".encode(encoding))
    assert [each.name for each in read_table(path).columns] == ["t", "h\u00f6he"]


def test_units_come_from_brackets_lines_of_units_and_names(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("Time (Seconds),x [m],y_mm,stamp.nsecs,z\n0,1,2,3,4\n1,1,2,3,4\n")
    assert [each.unit for each in read_table(path).columns] == ["s", "m", "mm", "ns", ""]


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("t,x\n0,1\n1,2\n2,3,4\n3,4\n", "4:5", "3 cells"),
        ("t,x,y\n0,1,2\n1,2,3\n2;3;4\n3,4,5\n", "4:1", "separated by ','"),
        ("t,x,y\n0,1,2\n1,2,3\n2,3,4\n3,4", "5:3", "ends within a row"),
        ("t,x\n0.5,1,7\n0.7,2,9\n", "1:1", "2 names"),
        ("t,x,y\n1,2,3,4\n0,1,2\n1,2,3\n2,3,4\n", "2:1", "a line of 4 numbers"),
        (MOTIVE.replace("Frames,3", "Frames,9"), "1:63", "it was cut"),
        ('{\n"p": {"x": 1, "y": 2},\n"turn": {"roll": 1, "yaw": 2}\n}', "1:1", "no table"),
        ("#ROSBAG V2.0\n", "1:1", "rostopic echo"),
        ("words only\nand more words\n", "1:1", "no rows of numbers"),
    ],
)
def test_what_is_refused_has_its_place(text: str, place: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(BadInputError) as refused:
        read_table(path)
    found = refused.value.findings[0]
    assert f"{found.line}:{found.column}" == place
    assert words in found.message


def test_a_cell_that_is_no_number_is_kept_with_its_row(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,x\n0,1\n1,2\n2,3q\n3,4\n")
    table = read_table(path)
    assert table.column("x").bad == ((2, "3q"),)
    assert str(table.at(2, table.column("x"), "")).endswith("a.csv:4:3: ")


def test_a_number_beyond_doubles_is_kept_with_its_row(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text('{"t": 0, "x": 1}\n{"t": 1, "x": 1' + "0" * 400 + "}\n")
    ((row, cell),) = read_table(path).column("x").bad
    assert (row, len(cell)) == (1, 401)


@pytest.mark.parametrize("sign", ["#", "%", "//"])
def test_a_comment_states_a_fact(sign: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"{sign} Rate: 100\nx,y\n1,2\n3,4\n")
    assert read_table(path).facts["Rate"] == "100"


@pytest.mark.parametrize("line", ["sep=;", '"sep=;"'])
def test_a_line_that_names_the_separator_names_no_column(line: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"{line}\n1\n2\n3\n")
    assert [each.name for each in read_table(path).columns] == [""]


def test_a_name_that_stands_twice_is_refused_and_positions_name_both(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,x,x\n0,1,5\n1,2,6\n")
    table = read_table(path)
    with pytest.raises(BadInputError, match="write c2 or c3"):
        table.column("x")
    assert table.column("c3").values.tolist() == [5, 6]


def test_binary_tables_are_known_by_their_first_bytes(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.bin", t=np.arange(3.0), p=np.arange(9.0).reshape(3, 3))
    table = read_table(tmp_path / "a.bin.npz")
    assert [each.alias for each in table.columns] == ["t", "p[0]", "p[1]", "p[2]"]
    parquet = pytest.importorskip("pyarrow.parquet")
    import pyarrow as pa

    parquet.write_table(
        pa.table({"timestamp": [0.0, 0.1], "action": [[1.0, 2.0], [3.0, 4.0]]}), tmp_path / "b"
    )
    assert read_table(tmp_path / "b").column("action[1]").values.tolist() == [2.0, 4.0]
    scipy_io = pytest.importorskip("scipy.io")
    scipy_io.savemat(tmp_path / "c.mat", {"t": np.arange(4.0), "xyz": np.ones((4, 3))})
    assert read_table(tmp_path / "c.mat").column("xyz[2]").values.tolist() == [1.0] * 4
    walk = {"data": np.arange(20.0).reshape(5, 4), "freq": 120.0, "empty": np.zeros((0, 3))}
    scipy_io.savemat(tmp_path / "d.mat", {"walk": walk, "mass": np.ones(9)})
    found = read_table(tmp_path / "d.mat")
    assert found.column("walk.data[1]").values.tolist() == [1, 5, 9, 13, 17]
    assert "left out: mass" in found.notes[1]


def test_edited_bytes_leave_a_located_finding_or_the_other_rows(tmp_path: Path) -> None:
    """One byte of a file changed: never another error, and no other row changes."""
    rng = np.random.default_rng(3)
    rows = [f"{0.01 * k:.2f},{50 + 0.1 * k:.3f},{-0.2 * k:.4f}" for k in range(40)]
    text = ("t_s,x_mm,y_mm\n" + "\n".join(rows) + "\n").encode()
    path = tmp_path / "a.csv"
    path.write_bytes(text)
    truth = read_table(path)
    want = np.column_stack([each.values for each in truth.columns])
    read = 0
    for _ in range(400):
        edited = bytearray(text)
        place = int(rng.integers(len(text)))
        edited[place] = int(rng.integers(256))
        path.write_bytes(bytes(edited))
        try:
            table = read_table(path)
        except BadInputError:
            continue
        read += 1
        line = text[:place].count(b"\n") + 1
        others = [n for n, at in enumerate(table.lines) if at not in (line, line + 1)]
        assert len(table) >= len(truth) - 2
        for column in table.columns:
            if column.name in ("t_s", "x_mm", "y_mm") and not column.is_text:
                same = (
                    column.values[others]
                    == want[table.lines[others] - 2, ["t_s", "x_mm", "y_mm"].index(column.name)]
                )
                assert same.all(), bytes(edited)
    assert read > 50
