"""A trajectory that is loaded, waits at its first row and begins at a time: on the tick, or not at all."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader

from contid.client import Client, Code, RemoteError
from contid.control.engine.events import RunEvent
from contid.control.engine.events.robots import OrderRefused
from contid.control.engine.messages import Estop, Hold, Mark, Measured, Start
from contid.control.process.pace import PlannedStart
from tests.support.command import contid
from tests.support.daemons import HERE, armed, states
from tests.support.daemons import fast_daemon as daemon
from tests.support.waiting import until

pytestmark = pytest.mark.process

COLUMNS = ["t_s", "x_mm", "y_mm"]
ROWS = [[0.01 * n, 40.0 + 0.05 * n, 75.0] for n in range(50)]
PERIOD_S = 0.005


class Events:
    """A sink of events."""

    def __init__(self) -> None:
        self.events: list[RunEvent] = []

    def write(self, values: list[float]) -> None: ...

    def event(self, event: RunEvent) -> None:
        self.events.append(event)


@pytest.mark.parametrize(("at_s", "tick"), [(1.0, 200), (1.0024, 200), (1.0026, 201), (0.9976, 200)])
def test_the_tick_nearest_to_the_time_begins(at_s: float, tick: int) -> None:
    planned, sink = PlannedStart(PERIOD_S), Events()
    planned.plan(Start(at_s), 0.5, sink)
    begun = [n for n in range(100, 300) if planned.due(n * PERIOD_S, n * PERIOD_S + 1e-4) is not None]
    assert begun == [tick]
    assert not sink.events


def test_a_start_that_comes_too_late_is_refused() -> None:
    planned, sink = PlannedStart(PERIOD_S), Events()
    planned.plan(Start(1.0), 1.01, sink)
    assert planned.due(2.0, 2.0) is None
    assert isinstance(sink.events[0], OrderRefused)
    assert "10.0 ms after its time" in sink.events[0].message


def test_a_stop_cancels_a_start_and_a_measurement_does_not() -> None:
    for order in (Hold(), Hold(("f0",)), Estop()):
        planned = PlannedStart(PERIOD_S)
        planned.plan(Start(1.0), 0.5, Events())
        planned.cancel_for(order)
        assert planned.due(2.0, 2.0) is None
    planned.plan(Start(1.0), 0.5, Events())
    planned.cancel_for(Measured("f0", (0.0, 0.0, 0.0)))
    planned.cancel_for(Mark(3))
    assert planned.due(2.0, 2.0) is not None


def waits(client: Client) -> int:
    """A move that waits at its first row."""
    move = client.load(COLUMNS, ROWS)
    assert states(client) == {"HOLD"}
    client.start(move)
    until(lambda: states(client) == {"RUN"}, "it is at the first row")
    return move


@pytest.mark.realtime
def test_a_loaded_trajectory_begins_at_its_time_and_replays_bit_for_bit(tmp_path: Path) -> None:
    session = tmp_path / "s.mcap"
    with daemon(1, "--record", str(session)) as running, running.client() as client:
        armed(client)
        client.move(HERE)
        move = waits(client)
        time.sleep(0.3)
        assert client.status()["source_s"] == 0.0
        assert client.status()["robots"]["f0"]["tip_mm"] == pytest.approx((40.0, 75.0, 0.0), abs=0.5)
        at_s = time.monotonic() + 0.4
        assert client.start(move, at_s)["at_s"] == at_s
        client.wait(move)
        started = client._procedures._protocol.started[move]
        assert started["at_s"] == at_s
        assert client.status()["robots"]["f0"]["tip_mm"] == pytest.approx((42.45, 75.0, 0.0), abs=0.5)
        running.end()
    done = contid("replay", str(session), "--json")
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads(done.stdout)["ticks"] > started["tick"]
    # By another reader: the order lies at the tick of the notice, whose deadline is nearest to the time.
    with session.open("rb") as file:
        read = [
            (c.topic, json.loads(m.data)) for _, c, m in make_reader(file).iter_messages(["event", "tick"])
        ]
    (order,) = [fields for topic, fields in read if topic == "event" and fields.get("order") == "go"]
    assert order == {"event": "order", "order": "go", **{k: started[k] for k in ("tick", "at_s", "began_s")}}


@pytest.mark.realtime
def test_what_cannot_start_is_refused_and_nothing_moves() -> None:
    with daemon() as running, running.client() as client, running.client() as other:
        armed(client)
        with pytest.raises(RemoteError, match="does not wait for a start"):
            client.start(1, time.monotonic() + 1.0)
        with pytest.raises(RemoteError, match="rows need t_s"):
            client.load(["x_mm", "y_mm"], [(40.0, 75.0)])
        with pytest.raises(RemoteError, match="reach"):
            client.load(COLUMNS, [[0.0, 400.0, 75.0], [1.0, 401.0, 75.0]])
        move = client.load(COLUMNS, ROWS)
        with pytest.raises(RemoteError, match="not at the first row") as refused:
            client.start(move, time.monotonic() + 1.0)
        assert refused.value.code == Code.REFUSED
        with pytest.raises(RemoteError, match="does not wait"):
            other.start(move)
        client.start(move)
        until(lambda: states(client) == {"RUN"}, "it is at the first row")
        for ahead_s in (-1.0, 0.1, 61.0):
            with pytest.raises(RemoteError, match=r"0.2 to 60 s ahead"):
                client.start(move, time.monotonic() + ahead_s)
        client.start(move, time.monotonic() + 0.5)
        other.hold()
        with pytest.raises(RemoteError, match=r"stopped the robots|hold"):
            client.wait(move)
        time.sleep(0.7)
        assert states(client) == {"HOLD"}
        assert client.status()["robots"]["f0"]["tip_mm"] == pytest.approx((40.0, 75.0, 0.0), abs=0.5)
