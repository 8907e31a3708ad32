"""Recordings of a common run: replayed bit for bit, and merged on one clock, also with clocks hours apart."""

from __future__ import annotations

import json
import os
from contextlib import ExitStack
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from contid.control.engine.events.run import NoteWritten
from contid.errors import ContidError
from contid_fleet.clocks import measure_offset
from contid_fleet.operator import FleetOperator
from contid_sessions.clock_notes import clock_notes
from tests.support.command import contid
from tests.support.daemons import armed
from tests.support.daemons import fast_daemon as daemon
from tests.support.fleets import bridge
from tests.support.time_namespace import prefix
from tests.support.waiting import until

pytestmark = pytest.mark.process

NODES = ("hand1", "hand2")
ROWS = "t_s,hand1/x_mm,hand1/y_mm,hand2/x_mm,hand2/y_mm\n" + "".join(
    f"{0.01 * n:.2f},{30 + 5 * (n / 100) ** 2 * (3 - 2 * n / 100):.4f},80,{-30 - 0.02 * n},80\n"
    for n in range(101)
)


def note(at_s: float, offset_s: float, node: str = "hand1", conductor: str = "boot") -> NoteWritten:
    return NoteWritten(
        experiment="e", node=node, conductor=conductor, at_s=at_s, offset_s=offset_s, bound_s=1e-4, wall_s=1e9
    )


@given(
    offset_s=st.floats(-1e5, 1e5),
    drift=st.floats(-1e-4, 1e-4),
    times=st.lists(st.floats(0.0, 1e4), min_size=1, unique=True),
    share=st.floats(0.0, 1.0),
)
def test_a_clock_that_drifts_evenly_is_met_between_its_notes(
    offset_s: float, drift: float, times: list[float], share: float
) -> None:
    (clock,) = clock_notes("s", [note(t, offset_s + drift * t) for t in times]).values()
    at_s = min(times) + share * (max(times) - min(times))
    assert clock.conductor_s(at_s) == pytest.approx(at_s - offset_s - drift * at_s, abs=1e-6)
    assert clock.offset_s(min(times) - 100.0) == offset_s + drift * min(times)
    assert clock.offset_s(max(times) + 100.0) == offset_s + drift * max(times)


def test_notes_are_kept_by_conductor_and_for_one_node() -> None:
    found = clock_notes("s", [note(1.0, 2.0), note(1.0, 3.0, conductor="other"), note(1.0, 9.0)])
    assert {name: clock.offset_s(0.0) for name, clock in found.items()} == {"boot": 2.0, "other": 3.0}
    with pytest.raises(ContidError, match="several nodes: hand1, hand2"):
        clock_notes("s", [note(1.0, 2.0), note(2.0, 2.0, node="hand2")])


@pytest.mark.realtime
@pytest.mark.parametrize("ahead_s", [pytest.param(0, marks=pytest.mark.campaign), 5000])
def test_a_recorded_run_is_replayed_and_merged(ahead_s: int, tmp_path: Path) -> None:
    if ahead_s and (os.geteuid() != 0 or not Path("/proc/self/timens_offsets").exists()):
        pytest.skip("a time namespace needs root and Linux 5.6")
    sessions = [tmp_path / f"{name}.mcap" for name in NODES]
    (tmp_path / "both.csv").write_text(ROWS)
    with ExitStack() as stack:
        daemons, bridges = {}, []
        for name, path, seconds in zip(NODES, sessions, (0, ahead_s), strict=True):
            ahead = prefix(seconds)
            daemons[name] = stack.enter_context(daemon(1, "--record", str(path), prefix=ahead))
            bridges.append(stack.enter_context(bridge({name: daemons[name].socket}, prefix=ahead)))
            with daemons[name].client() as client:
                armed(client)
        endpoints = [each.endpoint for each in bridges]
        with FleetOperator(bridges[0].operator(connect=endpoints)) as operator:
            until(lambda: operator.nodes().keys() == {*NODES}, "both nodes have a token")
            offset = measure_offset(operator, "hand2")
            assert abs(offset.offset_s - ahead_s) <= offset.bound_s, "the truth is known"
        file = str(bridges[0].operator_file(connect=endpoints))
        done = contid("fleet", "run", str(tmp_path / "both.csv"), "--json", "--file", file)
        assert done.returncode == 0, done.stderr
        report = json.loads(done.stdout)
        assert report["skew_ms"] <= 5.0 + report["bound_ms"], report
        for each in daemons.values():
            each.end()

    done = contid("fleet", "replay", str(tmp_path), "--json")
    assert done.returncode == 0, done.stdout + done.stderr
    replayed = json.loads(done.stdout)
    assert replayed["sessions"].keys() == {"hand1.mcap", "hand2.mcap"}
    assert all(each["ticks"] > 200 for each in replayed["sessions"].values())
    start = replayed["starts"][report["experiment"]]
    assert start["skew_ms"] == pytest.approx(report["skew_ms"], abs=2.0 * report["bound_ms"] + 0.01)

    merged = tmp_path / "merged.mcap"
    done = contid("session", "merge", *map(str, sessions), "-o", str(merged))
    assert done.returncode == 0, done.stderr
    shifts: dict[str, list[float]] = {name: [] for name in NODES}
    counts: dict[str, int] = {}
    times, newest = [], 0
    with merged.open("rb") as opened:
        reader = make_reader(opened)
        for _, channel, message in reader.iter_messages():
            _, name, topic = channel.topic.split("/")
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            shifts[name].append((message.log_time - message.publish_time) * 1e-9)
            assert message.log_time >= newest, "in the order of the common clock"
            newest = message.log_time
            fields = json.loads(message.data)
            if topic == "event" and fields.get("order") == "go":
                times.append(fields["began_s"] - (ahead_s if name == "hand2" else 0))
        found = {each.name: each.metadata for each in reader.iter_metadata()}
    for name, path in zip(NODES, sessions, strict=True):
        with path.open("rb") as original:
            messages = sum(1 for _ in make_reader(original).iter_messages())
        assert messages == sum(n for topic, n in counts.items() if topic.split("/")[1] == name)
        # One machine has one time of day: both were moved by the same time, within the bound.
        bound_s = float(found[f"merged/{name}"]["bound_s"])
        assert max(map(abs, shifts[name])) < 2.0 * bound_s + 0.002
    # The beginnings, on the clock that both share in truth.
    skew_ms = (max(times) - min(times)) * 1e3
    assert skew_ms == pytest.approx(report["skew_ms"], abs=report["bound_ms"] + 0.01)

    again = contid("session", "merge", *map(str, sessions), "-o", str(merged))
    assert again.returncode == 2
    assert "exists" in again.stderr
    info = contid("session", "info", str(merged))
    assert info.returncode == 2
    assert "one of the originals" in info.stderr
    twice = contid("session", "merge", str(sessions[0]), str(sessions[0]), "-o", str(tmp_path / "x.mcap"))
    assert twice.returncode == 2
    assert "several sessions of node 'hand1'" in twice.stderr
    assert not (tmp_path / "x.mcap").exists()


def test_sessions_without_notes_are_not_merged(tmp_path: Path) -> None:
    golden = sorted((Path(__file__).parents[3] / "tests" / "golden").glob("*.mcap"))[:2]
    done = contid("session", "merge", *map(str, golden), "-o", str(tmp_path / "m.mcap"))
    assert done.returncode == 2
    assert "no note of a fleet run" in done.stderr
    one = contid("session", "merge", str(golden[0]), "-o", str(tmp_path / "m.mcap"))
    assert "two sessions at least" in one.stderr
    none = contid("fleet", "replay", str(tmp_path))
    assert none.returncode == 2
    assert "no session" in none.stderr
