"""Angles beyond a limit are named with it, and columns that wrap get a note."""

from __future__ import annotations

import io

import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.preflight.rows import Preflight
from contid.errors import BadInputError
from contid.robot_file.load import LoadedFile, find_robot_file, parse_robot_file
from contid.trajectory.read import read_trajectory
from contid.trajectory.timed import MAX_NOTES, Trajectory, whole_turns


def finger_with_wrist(limits_deg: str) -> LoadedFile:
    text = find_robot_file("finger").read_text(encoding="utf-8")
    rates = "      velocity_deg_s: 300\n      acceleration_deg_s2: 5000\n      jerk_deg_s3: 100000\n"
    text = text.replace("    rates:\n", f"    extra_deg: {{wrist: {limits_deg}}}\n    rates:\n{rates}", 1)
    wrist = "      wrist: {bus: servos, id: 3, zero_deg: 180}\n"
    return parse_robot_file(text.replace("    axes:\n", f"    axes:\n{wrist}", 1), "wrist.yaml")


def rows(loaded: LoadedFile, *angles_deg: float) -> Trajectory:
    lines = [f"{2 * k},20,80,{angle}" for k, angle in enumerate(angles_deg)]
    text = "\n".join(["t_s,x_mm,y_mm,wrist_deg", *lines])
    return read_trajectory(io.StringIO(text), "t.csv", loaded.driven)


def test_a_wrist_beyond_its_limit_is_named_with_the_limit() -> None:
    loaded = finger_with_wrist("[-180, 180]")
    with pytest.raises(BadInputError) as caught:
        Preflight(build_robot_configs(loaded, 100.0)).trajectory(rows(loaded, 0, 200), "t.csv")
    (found,) = caught.value.findings
    assert found.line == 3
    assert found.message.endswith("wrist 200 deg is 20 deg beyond its limit of 180 deg")


def test_a_column_that_wraps_gets_a_note_with_the_angle_to_write() -> None:
    loaded = finger_with_wrist("[-720, 720]")
    (note,) = whole_turns(rows(loaded, 160, 170, 180, -170, -160), "t.csv")
    assert note.startswith("t.csv:5: wrist_deg goes from 180 to -170, which turns the axis by -350 degrees")
    assert note.endswith("write 190 (+10 degrees)")
    assert list(whole_turns(rows(loaded, 0, 170, 190, 10), "t.csv")) == []


def test_notes_are_few() -> None:
    found = list(whole_turns(rows(finger_with_wrist("[-720, 720]"), *[0, 350] * 5), "t.csv"))
    assert len(found) == MAX_NOTES + 1
    assert found[-1] == "t.csv: 9 rows turn an axis by more than half a turn"
