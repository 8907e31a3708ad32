"""A recording whose robot file has keys of an older revision (`dead_man`), made by the code of that time."""

from __future__ import annotations

from pathlib import Path

from contid.robot_file.load import parse_robot_file
from contid.session.read import Session
from contid_sessions.replay.differences import differences
from contid_sessions.replay.replay import replay

RECORDING = Path(__file__).parent / "revisions" / "renamed-keys.mcap"


def test_it_replays_bit_for_bit() -> None:
    session = Session(RECORDING)
    assert "dead_man: relax" in session.robot_text
    replayed = replay(session, session.robot_file(), 0.0)
    assert replayed.ticks > 200
    assert replayed.divergence is None


def test_a_renamed_key_is_no_difference() -> None:
    text = Session(RECORDING).robot_text
    today = text.replace("dead_man", "on_watchdog")
    assert parse_robot_file(today, "today.yaml").file.name == "old"
    assert differences(text, today) == differences(text, text) == []
    assert [str(each) for each in differences(text, today.replace("relax", "hold"))] == [
        "robots.arm.axes.s1.l1.on_watchdog: 'relax' -> 'hold'"
    ]
