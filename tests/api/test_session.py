"""`Session` against the CSV that `contid session export` writes in another process."""

from __future__ import annotations

import csv
import math
import sys
from pathlib import Path

import pytest

from contid import Robot, Session, Sim
from contid.control.engine.events.robots import ModeChanged
from contid.errors import ContidError, MissingExtraError
from tests.support.command import contid


@pytest.fixture(autouse=True)
def short_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables are read in blocks of thousands of rows; here one recording has more than one."""
    monkeypatch.setattr("contid_sessions.table._BLOCK", 256)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hand that moves, is refused for a while, and a trajectory of more ticks than one block."""
    path = tmp_path_factory.mktemp("session") / "s.mcap"
    with Sim("hand", record=path) as sim:
        for step in range(300):
            far = 500.0 if 100 < step < 120 else 0.0
            sim.step(
                {"left.x_mm": 10.0 + far, "left.y_mm": 80.0, "right.left_mm": 60.0, "right.right_mm": 61.0}
            )
        sim.step(ticks=400)
    return path


def exported(file: Path, folder: Path) -> list[dict[str, str]]:
    table = folder / "all.csv"
    done = contid("session", "export", str(file), "--csv", str(table))
    assert done.returncode == 0, done.stderr
    with table.open() as lines:
        return list(csv.DictReader(lines))


@pytest.mark.process
def test_the_table_is_the_export_of_the_command_line(file: Path, tmp_path: Path) -> None:
    printed = exported(file, tmp_path)
    frame = Session(file).to_pandas()
    assert len(frame) == len(printed) > 650
    assert frame.index.name == "t_s"
    assert [*printed[0]] == [frame.columns[0], "t_s", *frame.columns[1:]]
    for name in frame.columns:
        cells = [row[name] for row in printed]
        # Microseconds of the day: the float next to it differs in the seventh decimal.
        tolerance = 1e-6 if name == "unix_s" else 0.0
        for cell, value in zip(cells, frame[name].tolist(), strict=True):
            assert math.isnan(value) if cell == "" else abs(float(cell) - value) <= tolerance, name
    assert [float(row["t_s"]) for row in printed] == frame.index.tolist()
    assert str(frame["tick.left.mode"].dtype) == "int64"
    assert frame.attrs["rate_hz"] == 200.0


def test_iteration_gives_the_rows_of_the_table(file: Path) -> None:
    session = Session(str(file))
    frame = session.to_pandas().reset_index()
    for number, row in enumerate(session):
        if number % 100 == 0:
            expected = frame.iloc[number].to_dict()
            assert row.keys() == expected.keys()
            assert all(row[key] == value or math.isnan(row[key]) for key, value in expected.items())
    assert number == len(frame) - 1


def test_the_robots_and_events_of_a_session(file: Path) -> None:
    session = Session(file)
    assert [*session.robots] == ["left", "right"]
    left = session.robots["left"]
    assert (left.model, left.quantity, left.axes) == ("rack_finger", "mm", ("left", "right"))
    modes = [
        event.mode for event in session.events() if isinstance(event, ModeChanged) and event.robot == "left"
    ]
    assert modes[:4] == ["CONNECTING", "ARMING", "HOLD", "APPROACH"]
    assert "HOLD" in modes[5:]


def test_the_table_goes_into_the_kinematics(file: Path) -> None:
    frame = Session(file).to_pandas()
    right = Robot("hand")["right"]
    lengths = frame[[f"command.right.{axis}" for axis in right.axes]].dropna()
    tips = right.fk(lengths).tip
    assert tips.shape == (len(lengths), 2)
    assert tips[-1] == pytest.approx(right.fk([60.0, 61.0]).tip)


def test_a_truncated_file_is_read_up_to_its_end(file: Path, tmp_path: Path) -> None:
    (tmp_path / "cut.mcap").write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    session = Session(tmp_path / "cut.mcap")
    assert 0 < len(session.to_pandas()) < len(Session(file).to_pandas())


def test_mistakes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: Path) -> None:
    with pytest.raises(ContidError, match="No such file"):
        Session(tmp_path / "nothing.mcap")
    (tmp_path / "a.mcap").write_text("no session")
    with pytest.raises(ContidError, match="not an MCAP file"):
        Session(tmp_path / "a.mcap")
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingExtraError, match=r"to_pandas needs pandas: pip install 'contid\[data\]'"):
        Session(file).to_pandas()
    assert next(iter(Session(file)))["tick"] == 0.0
