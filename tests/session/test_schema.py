"""Every message of recorded runs matches the JSON Schema in its file, as read by stock libraries."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader

from contid.control.tick.config import MOTION_RULES
from contid.errors import SessionError
from contid.session.format.channels import EVENT, INFINITE, REVISION, TICK_CHANNELS
from contid.session.read import Session
from contid_sessions.replay.replay import replay
from tests.golden.make import TOLERANCE
from tests.session.runs import RUNS

#: A session of every revision, written by the code of that revision; `tracked_hand` from revision 1 on.
REVISIONS = [Path(__file__).parent / "revisions" / f"{number}.mcap" for number in range(REVISION)]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("runs")
    return [run(folder / f"{name}.mcap") for name, run in RUNS.items()]


def _messages(path: Path) -> Iterator[tuple[str, bytes, dict[str, Any]]]:
    """Topic, schema and message, by the stock reader."""
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            yield channel.topic, schema.data, json.loads(message.data, parse_constant=_refuse)


def _refuse(constant: str) -> float:
    raise AssertionError(f"{constant} is no JSON")


def test_every_message_matches_the_schema_in_its_file(runs: list[Path]) -> None:
    for path in runs:
        validators: dict[bytes, Draft202012Validator] = {}
        for _, schema, message in _messages(path):
            if schema not in validators:
                Draft202012Validator.check_schema(json.loads(schema))
                validators[schema] = Draft202012Validator(json.loads(schema))
            validators[schema].validate(message)
        assert len(validators) == 7


def test_the_keys_of_events_are_described(runs: list[Path]) -> None:
    """All but the arguments of orders."""
    more = {"robots", "target", "targets", "tip_m", "direction", "policy"}
    for path in runs:
        for topic, schema, message in _messages(path):
            if topic == EVENT:
                assert message.keys() <= json.loads(schema)["properties"].keys() | more


def test_the_runs_have_every_key_and_lack_every_key_that_may_be_absent(runs: list[Path]) -> None:
    """The test above covers every key, present and absent."""
    seen: dict[str, set[bool]] = defaultdict(set)
    for path in runs:
        for topic, schema, message in _messages(path):
            for key, there in _optional(json.loads(schema), message) if topic != EVENT else ():
                seen[f"{topic} {key}"].add(there)
    assert {key for key, how in seen.items() if True not in how} == {
        "sample tension_n",  # of boards with load cells: tests/firmware/tendons
        *(f"{channel} {INFINITE}" for channel in TICK_CHANNELS),
    }
    measured = {key for key in seen if key.startswith("measured ")}
    assert {key for key, how in seen.items() if False not in how} - measured == {
        *("tick deadline_s", "tick lateness_s", "tick work_s"),  # of every recorded tick
        *("sample value_rad", "sample velocity_rad_s", "sample value_pa", "sample velocity_pa_s"),
        *(
            "sample time_s",
            "sample age_s",
            "sample effort",
        ),  # simulated devices have them from the first tick
    }


def _optional(schema: dict[str, Any], message: dict[str, Any]) -> Iterator[tuple[str, bool]]:
    """Last key of every value that may be absent, and whether it is present."""
    for key, about in schema["properties"].items():
        if about["type"] == "object":
            yield from _optional(about, message[key])
        elif key not in schema["required"]:
            yield key, key in message


def test_a_session_of_newer_motion_rules_is_refused_with_the_remedy(
    growing: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its stops would be others."""
    monkeypatch.setattr("contid.session.read.MOTION_RULES", MOTION_RULES - 1)
    with pytest.raises(SessionError, match=rf"motion rules {MOTION_RULES}; .*: update contid"):
        Session(growing)


@pytest.mark.parametrize("path", REVISIONS, ids=lambda path: path.stem)
def test_sessions_of_every_revision_are_read_and_replayed(path: Path) -> None:
    session = Session(path)
    assert session.metadata["contid"].get("revision", "0") == path.stem
    assert not Path(session.metadata["robot_file"]["name"]).is_absolute()
    result = replay(session, session.robot_file(), TOLERANCE)
    assert session.end.clean
    assert (result.divergence, result.stopped) == (None, "")
    assert result.ticks > 50


def test_a_session_of_a_newer_revision_is_refused_with_the_remedy(growing: Path, tmp_path: Path) -> None:
    """Its keys may have another meaning."""
    written = b"revision\x01\0\0\0%d"
    newer = tmp_path / "newer.mcap"
    content = growing.read_bytes()
    assert content.count(written % REVISION) == 1
    newer.write_bytes(content.replace(written % REVISION, written % (REVISION + 1)))
    with pytest.raises(
        SessionError, match=rf"revision {REVISION + 1} .* revisions 0 to {REVISION}: update contid"
    ):
        Session(newer)


@pytest.mark.parametrize("path", REVISIONS, ids=lambda path: path.stem)
def test_values_of_every_revision_are_those_in_the_file(path: Path) -> None:
    """Independent of the tested code: null and missing keys are NaN."""
    records = iter(Session(path).ticks())
    for topic, _, message in _messages(path):
        if topic == "sample":
            record = next(records)
            for robot, sample in zip(record.robots, message["robots"].values(), strict=True):
                seen = sample.get("measured_tip_m") or [math.nan] * 3
                assert repr(list(robot.measured_tip_m)) == repr(seen)
                for axis, name in zip(robot.axes, ("left", "right"), strict=True):
                    assert (axis.value, axis.valid) == (sample[name]["value_rad"], sample[name]["valid"])
    assert next(records, None) is None
