"""Golden sessions: every shipped robot still gives the recorded commands, and a change is detected.

Bounds on both sides. From above: commands stay within `TOLERANCE` of the recorded ones, whatever compiler,
C library and processor the kernels were built for (with one and the same build replays are equal bit for bit:
tests/session/test_replay.py). From below: with that tolerance, a thousandth of a millimetre in a geometry key
fails.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from contid.robot_file.load import LoadedFile, parse_robot_file, with_mock
from contid.session.read import Session
from contid_sessions.replay.replay import replay
from tests.golden.make import FOLDER, TOLERANCE, names

#: Two of motion rules 1; those of `FOLDER` are of rules 0 until a change of commands needs new ones.
RULES_1 = FOLDER / "motion_rules_1"
#: A geometry key of each file, a thousandth of a millimetre larger.
MUTATIONS = {
    "bend1": ("length_mm: 120,", "length_mm: 120.001,"),
    "catheter": ("radius_mm: [5]", "radius_mm: [5.001]"),
    "chambers3": ("length_mm: 60.0", "length_mm: 60.001"),
    "planar2": ("length_mm: 100,", "length_mm: 100.001,"),
    "trunk": ("length_mm: 106,", "length_mm: 106.001,"),
    "cbha": ("radius_mm: [40,", "radius_mm: [40.001,"),
    "chain": ("radius_mm: [40,", "radius_mm: [40.001,"),
    "finger": ("rack_spacing_mm: 13", "rack_spacing_mm: 13.001"),
    "hand": ("rack_spacing_mm: 13", "rack_spacing_mm: 13.001"),
    "stiffflop1": ("length_mm: 42.0", "length_mm: 42.001"),
    "stiffflop2": ("length_mm: 42.0", "length_mm: 42.001"),
    "ftdcr_v4": ("length_mm: 62.5", "length_mm: 62.501"),
    "tendon3": ("length_mm: 100,", "length_mm: 100.001,"),
    "trirack": ("rack_radius_mm: 35", "rack_radius_mm: 35.001"),
    "trirack2": ("rack_radius_mm: 35", "rack_radius_mm: 35.001"),
}


def test_every_shipped_robot_file_has_one() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.mcap")) == names() == sorted(MUTATIONS)


@pytest.fixture(params=names())
def session(request: pytest.FixtureRequest) -> Session:
    """Each golden session."""
    return Session(FOLDER / f"{request.param}.mcap")


def test_commands_are_those_that_were_recorded(session: Session) -> None:
    result = replay(session, session.robot_file(), TOLERANCE)
    assert (result.divergence, result.stopped) == (None, "")
    assert session.end.clean  # only a replay to the end finds out
    assert result.ticks > 80


def test_a_thousandth_of_a_millimetre_is_noticed(session: Session) -> None:
    result = replay(session, _changed(session), TOLERANCE)
    assert result.divergence is not None
    assert result.divergence.what == "command"
    assert result.divergence.last_equal["tick"] < result.divergence.tick


@pytest.mark.parametrize("name", ["finger", "stiffflop1"])
def test_a_recording_is_replayed_by_the_rules_of_its_motions(name: str) -> None:
    """By rules 1 a stop ends a tick later, at most 0.005 mm or 1e-4 bar elsewhere."""
    session = Session(RULES_1 / f"{name}.mcap")
    assert (session.motion_rules, Session(FOLDER / f"{name}.mcap").motion_rules) == (1, 0)
    result = replay(session, session.robot_file(), TOLERANCE)
    assert (result.divergence, result.stopped) == (None, "")
    session.motion_rules = 0
    result = replay(session, session.robot_file(), 5e-3)
    assert result.divergence is not None
    assert result.divergence.what == "mode"


def test_golden_sessions_are_small_and_machine_independent() -> None:
    for path in FOLDER.rglob("*.mcap"):
        assert path.stat().st_size < 150_000
        session = Session(path)
        assert session.metadata["contid"]["host"] == "golden"
        assert not Path(session.metadata["robot_file"]["name"]).is_absolute()


def _changed(session: Session) -> LoadedFile:
    old, new = MUTATIONS[session.path.stem]
    text = session.metadata["robot_file"]["text"]
    assert old in text
    return with_mock(parse_robot_file(text.replace(old, new, 1), "changed.yaml", recorded=True))
