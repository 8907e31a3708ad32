"""A machine that needs a feed: when it stops, every robot of the machine holds, also of a trajectory."""

from __future__ import annotations

import signal
import subprocess
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.errors import ContidError
from contid_fleet.commands.feed import FedMachines
from contid_fleet.feed_watch import FeedWatch
from contid_fleet.fleet_file import MachineFile
from contid_fleet.operator import FleetOperator
from tests.support.daemons import command, daemon, states
from tests.support.fingers import circle_csv
from tests.support.fleets import bridge, machine_file
from tests.support.waiting import until

AFTER_S = 0.5


@given(gaps=st.lists(st.floats(0.0, 2.0), max_size=30))
def test_it_lapses_once_after_each_feed_that_was_the_last(gaps: list[float]) -> None:
    watch, now_s, lapses, expected = FeedWatch("anna", AFTER_S), 0.0, 0, 0
    assert not watch.lapsed(1e9), "never before the first feed"
    for gap_s in gaps:
        assert watch.feed("anna", now_s)
        assert not watch.feed("bob", now_s + 10.0)
        fed_s, now_s = now_s, now_s + gap_s
        expected += now_s - fed_s > AFTER_S
        lapses += watch.lapsed(now_s)
        assert not watch.lapsed(now_s), "once"
    assert lapses == expected


def test_a_machine_that_answers_no_more_is_reported_once() -> None:
    lines: list[str] = []
    fed = FedMachines(1.0, lines.append)
    answer = {"ok": True, "result": {"after_s": 0.5}}
    for tenth in range(50):  # hand2 is silent from 1 s to 4 s
        fed.take("hand1", answer, 0.1 * tenth)
        if not 10 < tenth < 40:
            fed.take("hand2", answer, 0.1 * tenth)
        fed.look(0.1 * tenth)
    shown = "fed; its robots hold 0.5 s after the last feed"
    silent = "not fed: no answer for 1 s; look at its bridge"
    assert lines == [f"hand1: {shown}", f"hand2: {shown}", f"hand2: {silent}", f"hand2: {shown}"]


@pytest.mark.process
@pytest.mark.realtime
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP, signal.SIGINT])
def test_a_robot_of_a_trajectory_holds_when_the_feed_stops(number: signal.Signals, tmp_path: Path) -> None:
    rows = tmp_path / "circle.csv"
    rows.write_text(circle_csv(1, period_s=60.0, rows=600))
    with (
        daemon(1, "--trajectory", str(rows)) as one,
        bridge({"hand1": one.socket}, hold_without_feed={"operator": "anna", "after_s": AFTER_S}) as served,
        one.client() as client,
        FleetOperator(served.operator("bob")) as bob,
    ):
        until(lambda: states(client) == {"RUN"}, "it follows its trajectory")
        until(lambda: "hand1" in bob.nodes(), "the node has a token")
        refused = bob.ask("hand1", "feed", {}, 5.0)
        assert refused is not None
        assert refused["error"]["code"] == "forbidden"
        time.sleep(2.0 * AFTER_S)
        assert states(client) == {"RUN"}, "it was never fed"
        feeder = subprocess.Popen(
            command("fleet", "feed", "--file", str(served.operator_file())),
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        try:
            assert feeder.stdout is not None
            assert feeder.stdout.readline() == "hand1: fed; its robots hold 0.5 s after the last feed\n"
            time.sleep(2.0 * AFTER_S)
            assert states(client) == {"RUN"}
            begin_s = time.monotonic()
            feeder.send_signal(number)
            until(lambda: states(client) == {"HOLD"}, "it holds")
            assert AFTER_S - 0.2 < time.monotonic() - begin_s < AFTER_S + 1.5
            assert client.status()["lease"]["holder"] == "input"
            client.resume(after_stop=True)  # a person at the machine goes on without the feed
            time.sleep(2.0 * AFTER_S)
            assert states(client) == {"RUN"}, "it held once"
        finally:
            feeder.kill()
            feeder.communicate()


@pytest.mark.process
def test_without_need_a_feed_is_refused() -> None:
    with (
        daemon() as one,
        bridge({"hand1": one.socket}) as served,
        FleetOperator(served.operator()) as operator,
    ):
        until(lambda: "hand1" in operator.nodes(), "the node has a token")
        refused = operator.ask("hand1", "feed", {}, 5.0)
        assert refused is not None
        assert refused["error"]["message"] == "its machine needs no feed"


@pytest.mark.parametrize(
    ("feed", "message"),
    [
        ({"operator": "carl"}, "'carl' is no operator"),
        ({"operator": "anna", "after_s": 0.01}, "after_s"),
        ({}, "operator"),
    ],
)
def test_a_wrong_feed_is_refused(tmp_path: Path, feed: dict[str, object], message: str) -> None:
    path = machine_file(tmp_path, "tcp/127.0.0.1:7447", {"hand1": tmp_path / "s"}, hold_without_feed=feed)
    with pytest.raises(ContidError, match=message):
        MachineFile.load(path)
