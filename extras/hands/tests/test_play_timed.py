"""Where a motion with a time begins, and what becomes of refused rows; the daemon is a stand-in."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, cast

import pytest

from contid.client import Client
from contid_hands.teach.play import Player, StepRefusedError
from contid_hands.teach.pose_file import parse_pose_file

POSES = """\
contid_poses: 1
poses:
  bent: {target: {s1.bend_deg: 30, s1.azimuth_deg: 90}}
  there: {target: {x_mm: 10, y_mm: 20, z_mm: 90}}
sequence:
  - {pose: bent, time_s: 5}
  - {trajectory: line.csv}
"""
AXES = {f"s1.l{i}": {"min_bar": 0.0, "max_bar": 2.0} for i in (1, 2, 3)}
ARM = {
    "unit": "bar", "axes": AXES, "stop": {"estop": "vent"},
    "columns": ["s1.bend_deg", "s1.azimuth_deg", "x_mm", "y_mm", "z_mm", *(f"{axis}_bar" for axis in AXES)],
    "velocity_bar_s": 1.0, "acceleration_bar_s2": 10.0, "jerk_bar_s3": 100.0,
}  # fmt: skip


class Daemon:
    """Answers of a daemon whose arm is bent by 10 degrees."""

    def __init__(self) -> None:
        self.rows: list[Sequence[Sequence[float]]] = []
        self.refused: list[str] = []

    def request(self, verb: str, unless_stopped: bool) -> dict[str, Any]:
        assert (verb, unless_stopped) == ("acquire", True)
        return {}

    def describe(self) -> dict[str, Any]:
        return {"robots": {"arm": ARM}}

    def telemetry(self, fields: Sequence[str]) -> Iterator[dict[str, Any]]:
        values = {"command": [0.5, 0.6, 0.7], "command_tip_mm": [1.0, 2.0, 99.0], "bends": [10.0, 45.0]}
        while True:
            yield {"robots": {"arm": {field: values[field] for field in fields}}}

    def stream(self, columns: Sequence[str], rows: Sequence[Sequence[float]]) -> list[str]:
        self.rows.append(rows)
        return self.refused


def player(tmp_path: Path, daemon: Daemon) -> Player:
    (tmp_path / "line.csv").write_text("t_s,x_mm,y_mm,z_mm\n0,10,20,90\n")
    file = parse_pose_file(POSES, tmp_path / "p.yaml")
    return Player(cast(Client, daemon), file, (), lambda line: None)


def test_bends_and_tips_begin_where_they_are(tmp_path: Path) -> None:
    found = player(tmp_path, Daemon())
    _, rows = found.timed({"s1.bend_deg": 30.0, "s1.azimuth_deg": 90.0}, 5.0)
    assert rows[0] == [0.0, 10.0, 45.0]
    assert rows[-1] == [5.0, 30.0, 90.0]
    _, rows = found.timed({"x_mm": 10.0, "y_mm": 20.0, "z_mm": 90.0}, 1.0)
    assert rows[0] == [0.0, 1.0, 2.0, 99.0]


@pytest.mark.parametrize("bend", ["bend_deg", "curvature_per_m"])
def test_a_bend_turns_the_short_way(tmp_path: Path, bend: str) -> None:
    found = player(tmp_path, Daemon())
    found._last = {f"s1.{bend}": 30.0, "s1.azimuth_deg": 170.0}
    _, rows = found.timed({f"s1.{bend}": 30.0, "s1.azimuth_deg": -170.0}, 5.0)
    assert min(abs(azimuth) for _, _, azimuth in rows) == 170.0
    assert min(row[1] for row in rows) > 29.5


def test_to_the_other_side_a_bend_goes_through_straight(tmp_path: Path) -> None:
    found = player(tmp_path, Daemon())
    found._last = {"s1.bend_deg": 30.0, "s1.azimuth_deg": 45.0}
    _, rows = found.timed({"s1.bend_deg": 60.0, "s1.azimuth_deg": -135.0}, 5.0)
    assert min(row[1] for row in rows) < 2.0
    assert all(min(abs(row[2] - 45.0), abs(row[2] + 135.0)) < 1e-6 for row in rows if row[1] > 1e-6)


def test_refused_rows_end_the_sequence_where_they_are(tmp_path: Path) -> None:
    daemon = Daemon()
    daemon.refused = ["rows:1: out of reach"]
    with pytest.raises(StepRefusedError, match=r"p\.yaml:6:5: pose 'bent': refused: rows:1: out of reach"):
        player(tmp_path, daemon).play(1)
    assert len(daemon.rows) == 1
