"""The channel of measured axes and tips: added by compaction, from the samples, with the known load."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from mcap.reader import make_reader

from contid.control.engine.wiring import build_robot_configs
from contid.remote.server.telemetry_view import TelemetryView
from contid.session.format.channels import MEASURED, TICK_CHANNELS
from contid.session.format.record_stream import RecordStream
from contid.session.read import Session
from contid_sessions.compact import compact, repair
from contid_sessions.replay.replay import replay
from tests.session.runs import loaded_arm

REVISIONS = sorted((Path(__file__).parent / "revisions").glob("*.mcap"))
#: Of the robot file of `recorded`; its zeros are 0.
MM_PER_REV = 37.7
#: Modes of a robot that follows its target.
RUN = 5


def ticks(path: Path) -> list[dict[str, Any]]:
    """The messages of every tick by channel, with their times, by the stock reader."""
    found: dict[int, dict[str, Any]] = defaultdict(dict)
    with path.open("rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            if channel.topic in (*TICK_CHANNELS, MEASURED):
                fields = json.loads(message.data)
                assert channel.topic not in found[fields["tick"]], "once in every tick"
                assert found[fields["tick"]].setdefault("log_time", message.log_time) == message.log_time
                found[fields["tick"]][channel.topic] = fields
    return [found[tick] for tick in sorted(found)]


def test_every_tick_has_the_measured_axes_and_tip(recorded: Path) -> None:
    off_m = []
    for tick in ticks(recorded):
        for name, robot in tick[MEASURED]["robots"].items():
            sample, target = tick["sample"]["robots"][name], tick["target"]["robots"][name]
            lengths = [robot[f"{axis}_m"] for axis in ("left", "right")]
            angles = [sample[axis]["value_rad"] for axis in ("left", "right")]
            for length, angle in zip(lengths, angles, strict=True):
                assert length == pytest.approx(angle / math.tau * MM_PER_REV * 1e-3, rel=1e-8, abs=1e-12)
            if tick["tick"]["robots"][name]["mode"] == RUN:
                off_m.append(math.dist(robot["tip_m"], target["tip_m"]))
    assert len(off_m) > 100
    assert 0.0 < median(off_m) < 2e-3, "the simulated axes are late"


def test_a_session_that_was_cut_off_gets_it_by_repair(growing: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(growing.read_bytes()[: 3 * growing.stat().st_size // 4])
    assert all(MEASURED not in tick for tick in ticks_raw(cut))
    repair(cut, None)
    whole = ticks(cut)
    assert len(whole) > 100
    assert all(MEASURED in tick for tick in whole)
    before = cut.read_bytes()
    assert len(ticks(compact(cut, tmp_path / "again.mcap"))) == len(whole), "not a second one"
    assert cut.read_bytes() == before


def ticks_raw(path: Path) -> list[set[str]]:
    """Channels of a session that has no index."""
    from contid.session.format import mcap_records as mcap

    with path.open("rb") as file:
        bodies = [body for opcode, body in RecordStream(file) if opcode == mcap.CHANNEL]
    return [{mcap.decode(mcap.CHANNEL, body).topic for body in bodies}]


@pytest.mark.parametrize("path", REVISIONS, ids=lambda path: path.stem)
def test_sessions_of_older_versions_get_it_in_a_copy(path: Path, tmp_path: Path) -> None:
    """Revision 0 has no load; all are replayed as before."""
    copy = tmp_path / "copy.mcap"
    repair(path, copy)
    tips = [robot.get("tip_m") for tick in ticks(copy) for robot in tick[MEASURED]["robots"].values()]
    assert any(tips)
    assert all(math.isfinite(sum(tip)) for tip in tips if tip is not None)
    session = Session(copy)
    assert replay(session, session.robot_file(), 1e-6).divergence is None
    assert len(list(Session(copy).ticks())) == len(list(Session(path).ticks()))


def test_a_robot_file_that_is_refused_leaves_it_out(plain: Path, tmp_path: Path) -> None:
    source = tmp_path / "s.mcap"
    source.write_bytes(plain.read_bytes().replace(b"model: rack_finger", b"model: rack_linger"))
    whole = ticks(compact(source, tmp_path / "copy.mcap"))
    assert len(whole) > 100
    assert all(MEASURED not in tick for tick in whole)


def test_a_model_that_raises_an_error_costs_the_channel_and_not_the_recording(
    growing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Models come from other packages, too."""
    count = 0

    def forward(*_: object) -> None:
        nonlocal count
        count += 1
        if count > 200:
            raise RuntimeError("not in this version")

    monkeypatch.setattr("contid_sessions.measured.tip_in_world", forward)
    whole = ticks(compact(growing, tmp_path / "copy.mcap"))
    assert len(whole) == len(list(Session(growing).ticks()))
    assert all(MEASURED not in tick for tick in whole)
    assert "not in this version" in caplog.text
    assert [path.name for path in tmp_path.iterdir()] == ["copy.mcap"]


def test_tips_under_a_known_load_are_those_with_the_load(tmp_path: Path) -> None:
    """Recording and telemetry; the oracle is the tick, which has the error of the commanded tip."""
    path = loaded_arm(tmp_path / "s.mcap")
    session = Session(path)
    (config,) = build_robot_configs(session.robot_file(), session.rate_hz)
    view = TelemetryView(session.robot_file(), session.rate_hz, lambda: None)
    compared = 0
    for tick, record in zip(ticks(path), session.ticks(), strict=True):
        (robot,) = record.robots
        tip_m = tick[MEASURED]["robots"]["arm"].get("tip_m")
        command_mm = view.field(record, "arm", "command_tip_mm")
        if tip_m is None or command_mm is None:
            continue
        assert view.field(record, "arm", "tip_mm") == pytest.approx([1e3 * x for x in tip_m], abs=1e-5)
        if robot.mode == RUN and math.isfinite(robot.tip_error_m) and math.isfinite(robot.tip_m[0]):
            off_m = math.dist([1e-3 * x for x in command_mm], robot.tip_m)
            assert off_m == pytest.approx(robot.tip_error_m, abs=1e-9)
            if robot.load_n[2]:
                compared += 1
                actuation = tuple(axis.command for axis in robot.axes)
                free = config.frame.point_in_world(config.model.forward(actuation).tip_m)
                assert math.dist(free, robot.tip_m) > off_m + 1e-5, "without the load it is elsewhere"
    assert compared > 5
