"""A recording replays bit for bit for every kind of input; a difference is found and named."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import pytest

from contid.control.engine import messages as msg
from contid.control.engine.cycle import OnEnd
from contid.control.engine.events.robots import OrderGiven
from contid.control.engine.wiring import record_layout
from contid.control.process import ring
from contid.control.process.pipe import RunSetup
from contid.control.process.ring_writer import RingWriter
from contid.control.process.shared_files import folder
from contid.errors import ContidError
from contid.robot_file.load import parse_robot_file
from contid.session.read import Session
from contid.session.recording_observer import RecordingObserver
from contid.targets import Target
from contid_sessions.replay.compare import Divergence
from contid_sessions.replay.differences import differences
from contid_sessions.replay.replay import Replayed, replay
from contid_sessions.replay.report import as_json, as_text
from tests.golden.make import names, record
from tests.session.runs import record_virtual
from tests.support.fingers import circle, fingers, load


def _same(path: Path) -> Replayed:
    session = Session(path)
    result = replay(session, session.robot_file())
    assert (result.divergence, result.stopped) == (None, "")
    assert result.ticks == sum(1 for _ in session.ticks()) > 0
    return result


def test_a_timed_trajectory(recorded: Path) -> None:
    assert _same(recorded).largest == 0.0


#: One robot of each family of models; the recordings of all replay in tests/golden.
KINDS = ("chain", "hand", "stiffflop1", "tendon3", "trirack2")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in KINDS else pytest.mark.campaign) for name in names()]
)
def test_every_shipped_robot(name: str, tmp_path: Path) -> None:
    path = tmp_path / f"{name}.mcap"
    record(name, path)
    _same(path)


def test_orders_are_applied_at_their_ticks(tmp_path: Path) -> None:
    loaded = load(2)
    goto = msg.Goto("f0", Target(tip_m=(0.051, 0.077, 0.0)))
    orders: dict[int, list[msg.Message]] = {
        150: [msg.Hold()],
        200: [msg.Resume()],
        220: [msg.Hold(("f0",))],
        260: [goto],
        330: [msg.Resume(("f0",)), msg.Estop(("f1",))],
        400: [msg.Finish()],
    }
    path = record_virtual(tmp_path / "s.mcap", loaded, circle(loaded, period_s=3.0), orders)
    kinds = [event.order["order"] for event in Session(path).events() if isinstance(event, OrderGiven)]
    assert kinds == ["hold", "resume", "hold", "goto", "resume", "estop", "finish"]
    _same(path)


def test_it_goes_on_behind_another_number_and_names_the_largest_difference(recorded: Path) -> None:
    """Another processor or C library changes last bits; here a rack that is a nanometre wider does."""
    session = Session(recorded)
    wider = session.robot_text.replace("rack_spacing_mm: 13", "rack_spacing_mm: 13.000001")
    assert wider != session.robot_text
    result = replay(session, parse_robot_file(wider, "wider.yaml"))
    assert result.stopped == ""
    assert result.ticks == sum(1 for _ in session.ticks())
    assert result.divergence is not None
    assert result.worst is not None
    assert 0 < result.different <= result.ticks
    assert result.divergence.tick <= result.worst.tick
    # A nanometre of the spacing moves no rack by more than a few.
    assert 0.0 < result.largest == abs(result.worst.replayed - result.worst.recorded) < 1e-8


def test_rows_of_a_live_stream(tmp_path: Path) -> None:
    loaded = load(2)
    tips = [Target(tip_m=(0.05 + 0.004 * math.sin(n / 20), 0.075, 0.0)) for n in range(300)]
    orders: dict[int, list[msg.Message]] = {10 + n: [msg.Rows({"f0": tip})] for n, tip in enumerate(tips)}
    orders[40] += [msg.Rows({"f1": tips[0]})]
    orders[90] += [msg.Rows({"f1": None})]
    orders[310] = [msg.EndOfRows()]
    _same(record_virtual(tmp_path / "s.mcap", loaded, None, orders, ticks=500))


@pytest.mark.parametrize(
    "faults",
    [
        "{at_s: 0.4, kind: silent, axis: f0.left, for_s: 0.1}",
        pytest.param("{at_s: 0.4, kind: silent, axis: f0.left, for_s: 0.01}", marks=pytest.mark.campaign),
        "{at_s: 0.4, kind: lost, for_s: 0.25}",
        "{at_s: 0.4, kind: overload, axis: f0.right}",
        "{at_s: 0.4, kind: late, for_s: 0.1, delay_ms: 12}",
        "{at_s: 0.4, kind: stale, axis: f0.left, for_s: 0.1}",
    ],
)
def test_faults_of_devices(faults: str, tmp_path: Path) -> None:
    text = fingers(3, buses=2, options=f"faults:\n  - {faults}")
    loaded = parse_robot_file(text, "fingers.yaml")
    orders: dict[int, list[msg.Message]] = {150: [msg.ClearFault()], 170: [msg.Resume()], 300: [msg.Finish()]}
    path = record_virtual(tmp_path / "s.mcap", loaded, circle(loaded, period_s=1.0), orders, ticks=350)
    _same(path)


def test_a_millionth_of_a_millimetre_is_found_and_named(recorded: Path) -> None:
    session = Session(recorded)
    text = session.metadata["robot_file"]["text"]
    changed = parse_robot_file(
        text.replace("tip_length_mm: 22", "tip_length_mm: 22.000001", 1), "changed.yaml"
    )
    (key,) = differences(text, changed.text)
    assert str(key) == "robots.f0.geometry.tip_length_mm: 22 -> 22.000001"
    result = replay(session, changed)
    assert result.divergence is not None
    assert result.divergence.robot == "f0"
    assert 0.0 < abs(result.divergence.recorded - result.divergence.replayed) < 1e-8
    assert result.divergence.last_equal["tick"] == result.divergence.tick - 1
    assert replay(session, changed, tolerance=1e-4).divergence is None
    assert replay(session, changed, tolerance=1e-9).divergence is not None


def test_a_command_that_only_one_of_both_has_is_null_in_json(recorded: Path) -> None:
    session = Session(recorded)
    state = {"tick": 3, "mode": "OFF", "fault": "NONE", "left": {"solution": math.nan, "command": 0.1}}
    first = Divergence(4, 0.02, math.nan, "f0", "left", "command", math.nan, 0.1, "m", state)
    found = as_json(session, Replayed(9, first, 0.0), [], 1.0)["divergence"]
    text = json.dumps(found, allow_nan=False)
    assert json.loads(text)["recorded"] is None
    assert json.loads(text)["last_equal"]["left"] == {"solution": None, "command": 0.1}


def test_the_sign_of_zero_is_a_bit(recorded: Path) -> None:
    from contid_sessions.replay.compare import Comparison

    session = Session(recorded)
    values = next(entry.values for entry in session.entries() if entry.values is not None)
    slot = session.layout.axis_place(0, 0, "command")
    zero, minus = [*values], [*values]
    zero[slot], minus[slot] = 0.0, -0.0
    found = Comparison(session.layout, session.device_units, 0.0).check(zero, minus)
    assert found is not None
    assert found.where == "f0.left"
    assert Comparison(session.layout, session.device_units, 0.0).check(zero, zero) is None
    assert Comparison(session.layout, session.device_units, 1e-12).check(zero, minus) is None


def test_other_robots_are_refused(recorded: Path) -> None:
    with pytest.raises(ContidError, match="other robots or axes than recorded"):
        replay(Session(recorded), load(1))


def _without(recorded: Path, path: Path, missing: range) -> Session:
    """A copy of a recording of two fingers without these ticks."""
    loaded = load(2)
    recording = RecordingObserver(path, {"mock": "False"})
    sink = recording.follow(RunSetup(loaded, 200.0, Path(), circle(loaded), OnEnd.STOP, attended=False))
    assert record_layout(loaded, 200.0) == Session(recorded).layout
    for entry in Session(recorded).entries():
        if entry.event is not None:
            sink.event(entry.event)
        elif entry.values is not None and entry.values[0] not in missing:
            sink.write(entry.values)
    recording.detach()
    return Session(path)


def test_a_replay_goes_on_behind_a_gap(recorded: Path, tmp_path: Path) -> None:
    session = _without(recorded, tmp_path / "gap.mcap", range(100, 120))
    whole, result = _same(recorded), replay(session, load(2))
    assert (result.stopped, result.missing, result.divergence) == ("", 20, None)
    assert result.ticks == whole.ticks - 20
    assert "20 ticks are not in the recording" in "\n".join(as_text(session, result, [], 1.0))
    # What differs behind the gap is found: the robot of another file.
    text = fingers(2).replace("rack_spacing_mm: ", "rack_spacing_mm: 1")
    assert text != fingers(2)
    changed = parse_robot_file(text, "changed.yaml")
    assert replay(session, changed).divergence is not None


def test_orders_of_missing_ticks_are_applied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The recorder has a ring for ticks and one for events: an order is there although its tick is not."""
    loaded, play = load(2), msg.Play(circle(load(2), period_s=0.8, radius_mm=3.0))
    orders: dict[int, list[msg.Message]] = {150: [msg.Hold()], 200: [play, msg.Resume()], 800: [msg.Finish()]}
    path = record_virtual(tmp_path / "s.mcap", loaded, circle(loaded), orders, on_end=OnEnd.HOLD)
    both = [circle(loaded), play.trajectory]
    monkeypatch.setattr(Session, "trajectory", lambda session, loaded, number=0: both[number])
    for missing in (range(140, 160), range(190, 210)):
        result = replay(_without(path, tmp_path / f"{missing.start}.mcap", missing), loaded)
        # The gap is filled with a straight line of samples.
        assert (result.stopped, result.missing, result.largest < 1e-6) == ("", 20, True)


def test_a_gap_at_the_beginning_ends_the_replay(recorded: Path, tmp_path: Path) -> None:
    result = replay(_without(recorded, tmp_path / "gap.mcap", range(2)), load(2))
    assert (result.ticks, result.stopped) == (0, "ticks 0 to 1 are not in the recording")


def test_two_runs_in_one_file_are_detected(recorded: Path, tmp_path: Path) -> None:
    loaded = load(2)
    recording = RecordingObserver(tmp_path / "two.mcap", {"mock": "False"})
    sink = recording.follow(RunSetup(loaded, 200.0, Path(), circle(loaded), OnEnd.STOP, attended=False))
    for _ in range(2):
        for entry in Session(recorded).entries():
            if entry.event is not None:
                sink.event(entry.event)
            elif entry.values is not None:
                sink.write(entry.values)
    recording.detach()
    result = replay(Session(tmp_path / "two.mcap"), loaded)
    assert result.stopped == f"tick 0 comes after tick {result.ticks - 1}: more than one run is in the file"


def test_a_trajectory_of_an_order(tmp_path: Path) -> None:
    loaded = load(2)
    first, second = circle(loaded, period_s=0.5), circle(loaded, period_s=0.8, radius_mm=3.0)
    orders: dict[int, list[msg.Message]] = {
        150: [msg.Hold()], 200: [msg.Play(second), msg.Resume()], 500: [msg.Hold()],
        520: [msg.Play(first), msg.Resume()], 800: [msg.Finish()],
    }  # fmt: skip
    path = record_virtual(tmp_path / "s.mcap", loaded, first, orders, on_end=OnEnd.HOLD)
    _same(path)
    session = Session(path)
    list(session.entries())
    again = session.trajectory(loaded, 1)
    assert again is not None
    assert again.rows.tobytes() == second.rows.tobytes()
    assert session.trajectory(loaded, 3) is None


@pytest.mark.process
def test_the_recorder_attaches_the_trajectory_of_an_order(tmp_path: Path) -> None:
    """Through the observer and the recorder's process, before the order is in the ring."""
    loaded = load(2)
    shared = ring.create(record_layout(loaded, 200.0))
    writer = RingWriter(shared)
    recording = RecordingObserver(tmp_path / "s.mcap", {"mock": "False"})
    recording.attach(RunSetup(loaded, 200.0, shared, None, OnEnd.HOLD, attended=True), os.getpid())
    second = circle(loaded, period_s=0.8)
    recording.before_order(msg.Play(second))
    recording.before_order(msg.Hold())
    writer.event(OrderGiven(tick=0, order={"order": "play", "rows": len(second)}))
    writer.finish()
    assert recording.detach() == ()
    writer.close()
    shared.unlink()
    session = Session(tmp_path / "s.mcap")
    assert [*session.events()] == [OrderGiven(tick=0, order={"order": "play", "rows": len(second)})]
    again = session.trajectory(loaded, 1)
    assert again is not None
    assert again.rows.tobytes() == second.rows.tobytes()
    assert not list(folder().glob("contid-*.npz"))
