"""Measured tips over the socket: what they correct, one tracker per robot, bounded influence of a flood."""

from __future__ import annotations

import asyncio
import math
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contid.client import AsyncClient, Client, Code, RemoteError
from contid.control.engine.events.robots import OrderGiven
from contid.control.engine.wiring import build_robot_configs
from contid.kinematics.model import build_model
from contid.robot_file.load import load_robot_file, parse_robot_file
from contid.session.read import Session
from contid_sessions.replay.replay import replay
from tests.support.daemons import Running, armed
from tests.support.daemons import fast_daemon as daemon
from tests.support.fingers import fingers
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

EXAMPLE = Path(__file__).parents[2] / "examples" / "tracker.py"
TARGET_MM = (30.0, 70.0)
CORRECTION = "correction: {a_per_mm: 0.0013, b: -0.2774, arc_length_mm: [0, 213.4]}"
TIP = [50.0, 75.0]


def with_feedback(text: str) -> str:
    return text.replace(CORRECTION, "feedback: {}")


def wrong_plant() -> str:
    """The same finger, ten percent more curved: k = (L2 - L1) / (w S)."""
    text = with_feedback(fingers(1)).replace("rack_spacing_mm: 13", f"rack_spacing_mm: {13 / 1.1}")
    return text.replace(
        "link: {length_mm: 6, width_mm: 13, gap_mm: 5}", "link: {length_mm: 6, width_mm: 8, gap_mm: 5}"
    )


def stay(seconds: float = 600.0) -> str:
    x, y = TARGET_MM
    return f"t_s,x_mm,y_mm\n0,{x},{y}\n{seconds},{x},{y}\n"


def tick_of(client: Client) -> int:
    return int(client.status()["tick"])


def settled(client: Client) -> None:
    """The simulated servo has caught up with a robot that follows a target at rest."""
    until(lambda: client.status()["robots"]["f0"]["state"] == "RUN", "it follows")
    begun = tick_of(client)
    until(lambda: tick_of(client) > begun + 100, "half a second")


@pytest.mark.slow
def test_a_tracker_on_the_socket_takes_the_static_error_of_a_wrong_model_and_its_death_is_harmless(
    own_folder: Path,
) -> None:
    constant, plant, recording = (own_folder / name for name in ("t.csv", "plant.yaml", "s.mcap"))
    constant.write_text(stay())
    plant.write_text(wrong_plant())
    truth = build_model(load_robot_file(plant).file.robots["f0"])
    arguments = ("--trajectory", str(constant), "--on-end", "hold", "--record", str(recording))
    with daemon(1, *arguments, change=with_feedback) as running, running.client() as client:

        def error_mm() -> float:
            axes = client.status()["robots"]["f0"]["axes"].values()
            tip_m = truth.forward(tuple(axis["measured_mm"] / 1e3 for axis in axes)).tip_m
            return math.dist([1e3 * value for value in tip_m[:2]], TARGET_MM)

        settled(client)
        open_loop_mm = error_mm()
        assert open_loop_mm > 1.0, "the plant must be wrong enough to matter"
        asked = [sys.executable, str(EXAMPLE), "--socket", str(running.socket), "--plant", str(plant)]
        tracker = subprocess.Popen(asked, stdout=subprocess.PIPE, text=True)
        try:
            assert tracker.stdout is not None
            assert tracker.stdout.readline() == "f0: measured; feedback is on\n"
            until(lambda: error_mm() < 0.05 * open_loop_mm, "95 % of the error are gone")
            assert client.status()["trackers"]["f0"]["name"] == "tracker"
        finally:
            tracker.kill()
            tracker.communicate()
        killed = tick_of(client)
        until(lambda: tick_of(client) > killed + 220, "more than a second later")
        assert client.status()["trackers"] == {}
        assert error_mm() == pytest.approx(open_loop_mm, abs=0.05 * open_loop_mm)
        running.end()
        falls_back_without_a_jump(recording)


def _measured(session: Session) -> list[OrderGiven]:
    return [
        event
        for event in session.events()
        if isinstance(event, OrderGiven) and event.order["order"] == "measured"
    ]


def falls_back_without_a_jump(recording: Path) -> None:
    session = Session(recording)
    loaded = session.robot_file()
    config = build_robot_configs(loaded, session.rate_hz)[0]
    measured = [event.tick for event in _measured(session)]
    # Ticks that were skipped on a busy machine have not happened for anybody.
    ran = [(record.tick, [axis.command for axis in record.robots[0].axes]) for record in session.ticks()]
    first, last = (sum(tick < measured[end] for tick, _ in ran) for end in (0, -1))
    line = np.array([command for _, command in ran[first - 1 : last + 201]])
    before, corrected, after = line[0], line[last - first + 1], line[-1]
    assert len(line) == last - first + 202
    assert math.dist(corrected, before) > 1e-4
    assert after == pytest.approx(before, abs=1e-9), "open loop within one second"
    steps = np.diff(line, axis=0)
    assert np.abs(steps).max() <= config.velocity[0] * config.period_s
    assert np.abs(np.diff(steps, axis=0)).max() <= config.acceleration[0] * config.period_s**2 * (1.0 + 1e-9)
    result = replay(session, loaded)
    assert (result.divergence, result.stopped) == (None, "")


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "too few": ({"tip_mm": [50.0]}, "a list of two or three numbers"),
    "text": ({"tip_mm": "50,75"}, "a list of"),
    "null": ({"tip_mm": [50.0, None]}, r"tip_mm\[1\]: a finite number"),
    "true": ({"tip_mm": [50.0, True]}, r"tip_mm\[1\]"),
    "huge": ({"tip_mm": [50, 10**400]}, r"tip_mm\[1\]"),
    "missing": ({}, "tip_mm: a list"),
    "far": ({"tip_mm": [50.0, 750.0]}, "mm from the base is not this robot's"),
    "nowhere": ({"tip_mm": TIP, "direction": [0.0, 0.0]}, "must not be the zero vector"),
    "old": ({"tip_mm": TIP, "age_ms": 201.0}, "201 ms old; at most 200 ms"),
    "future": ({"tip_mm": TIP, "age_ms": -50.0}, "50 ms from now"),
    "other clock": ({"tip_mm": TIP, "time_s": 1.6e9}, "CLOCK_MONOTONIC"),
}


def test_wrong_measurements_are_named_and_a_robot_has_one_tracker() -> None:
    with daemon(1) as running, running.client(name="first") as first, running.client(name="other") as other:
        armed(first)
        for fields, message in BAD.values():
            with pytest.raises(RemoteError, match=message) as refused:
                first.request("measure", **fields)
            assert refused.value.code == Code.BAD_MEASUREMENT
        for fields, code in (
            ({"tip_mm": TIP, "robot": "thumb"}, Code.UNKNOWN_ROBOT),
            ({"tip_mm": TIP, "age_ms": 1.0, "time_s": time.monotonic()}, Code.BAD_REQUEST),
            ({"tip_mm": TIP, "tip_m": TIP}, Code.BAD_REQUEST),
        ):
            with pytest.raises(RemoteError) as refused:
                first.request("measure", **fields)
            assert refused.value.code == code
        assert first.status()["trackers"] == {}, "what is refused tracks nothing"
        result = first.measure(TIP, direction=[0.0, 2.0], age_ms=10.0)
        assert (result["robot"], result["used"], result["feedback"]) == ("f0", True, False)
        assert first.measure(TIP, age_ms=150.0)["used"] is False, "a newer one was there"
        late = first.track(TIP, time.monotonic() - 1.0)
        first.status()  # answered behind it
        late += first.track(TIP, time.monotonic())
        assert late[0].code == Code.BAD_MEASUREMENT
        for _ in range(100):  # more than may be on their way
            first.track(TIP, time.monotonic())
        with pytest.raises(RemoteError, match="client 'first' has tracked f0 for") as refused:
            other.measure(TIP)
        assert refused.value.code == Code.TRACKER_HELD
        until(lambda: other.status()["trackers"] == {}, "the tracker was silent for long enough")
        assert other.measure([50.0, 75.0, 3.0])["used"], "a planar robot takes no notice of the third number"
        status = other.status()
        assert status["trackers"]["f0"]["name"] == "other"
        frames = first.telemetry(100.0, fields=["measured_tip_mm", "measured_direction"])
        seen = next(frame["robots"]["f0"] for frame in frames if frame["robots"]["f0"]["measured_tip_mm"])
        assert seen == {"measured_tip_mm": [50.0, 75.0, 0.0], "measured_direction": None}
        frames.close()
        assert status["lease"]["holder"] is None, "measuring moves nothing"


async def test_a_flood_of_measurements_reaches_the_tick_no_more_often_than_it_ticks(own_folder: Path) -> None:
    recording = own_folder / "s.mcap"
    with daemon(1, "--record", str(recording)) as running:
        with running.client() as client:
            armed(client)
            begun = tick_of(client)
        async with AsyncClient(running.socket) as flooder, AsyncClient(running.socket) as person:

            async def flood() -> int:
                sent = 0
                while (await person.status())["tick"] < begun + 100:
                    await asyncio.gather(*(flooder.measure([50.0, 75.0 + 0.001 * k]) for k in range(20)))
                    sent += 20
                return sent

            sent = await flood()
            await person.hold()
        running.end()
    events = _measured(Session(recording))
    ticks = [event.tick for event in events]
    assert 10 < len(ticks) < sent
    # One is sent per record that is seen; it may come just after, or just before, a tick reads its orders.
    assert len(ticks) <= ticks[-1] - ticks[0] + 2
    assert max(map(ticks.count, ticks)) <= 2
    assert all(0.0 <= event.order["age_s"] < 0.2 for event in events)


def test_a_table_of_poses_is_played_in_time(own_folder: Path) -> None:
    poses = own_folder / "poses.csv"
    poses.write_text("t_s,x_mm,y_mm,ax,ay\n5.0,50,75,0,1\n5.02,50,75.1,0,1\n")
    with daemon(1) as running:
        asked = [sys.executable, str(EXAMPLE), "--socket", str(running.socket), "--csv", str(poses)]
        done = subprocess.run(asked, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert done.stdout == "f0: measured; feedback is off\n"
        _still_serves(running)


def _still_serves(running: Running) -> None:
    with running.client() as client:
        assert client.status()["trackers"] == {}
        parse_robot_file((running.folder / "fingers.yaml").read_text(), "fingers.yaml")
