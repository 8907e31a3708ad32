"""A body that lags slows its path, stays on it, and is a fault only where it does not come along."""

from __future__ import annotations

import io
import itertools
import math
from pathlib import Path
from random import Random
from typing import Any

import pytest

from contid.control.daemon.terminal import event_text
from contid.control.engine.events.robots import PathSlowed
from contid.control.engine.messages import Goto, Message
from contid.control.engine.report import RunReport
from contid.control.engine.virtual import run_virtual
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.faults import Fault
from contid.control.tick.supervisor import Mode
from contid.robot_file.load import parse_robot_file
from contid.session.read import Session
from contid.targets import Target
from contid.trajectory.read import read_trajectory
from contid_sessions.replay.replay import replay
from tests.session.runs import record_virtual
from tests.support.fingers import Collector, fingers, load

RATE = 200.0
WAY = "t_s,f0.x_mm,f0.y_mm\n0,50,75\n1,40,75\n3,60,85\n4,60,85\n"


def follow(fault: str, count: int = 1, axis: str = "f0.left") -> tuple[RunReport, Collector]:
    options = f"faults:\n  - {{at_s: 1.0, axis: {axis}, {fault}}}\n" if fault else ""
    loaded = load(count, options=options)
    seen = Collector(loaded)
    way = read_trajectory(io.StringIO(WAY), "way", loaded.driven)
    return run_virtual(loaded, RATE, way, sinks=[seen]), seen


def path_events(seen: Collector) -> list[tuple[str, bool]]:
    return [(event["axis"], event["over"]) for event in seen.events if event["event"] == "path"]


def test_a_slow_body_slows_its_path_and_stays_on_it() -> None:
    """84 deg/s are 8.8 mm/s of rack; the way asks for up to 17."""
    report, seen = follow("kind: slow, share: 0.07")
    plain, _ = follow("")
    assert report.exit_code == 0
    assert report.ticks > plain.ticks + 50
    assert report.robots["f0"]["tip_error_max_mm"] < 1e-9
    assert not report.robots["f0"]["ticks_limited"]
    assert path_events(seen) == [("f0.left", False), ("f0.left", True)]
    begun, over = (event for event in seen.events if event["event"] == "path")
    assert "f0.left is measured at" in begun["message"]
    assert over["lost_s"] == pytest.approx((report.ticks - plain.ticks) / RATE, abs=0.2)


def test_the_path_of_a_sound_body_is_not_touched() -> None:
    seen = [follow(fault)[1] for fault in ("", "kind: slow, share: 0.5")]
    assert path_events(seen[0]) == path_events(seen[1]) == []
    first, second = (
        [axis.command for record in each.records for axis in record.robots[0].axes] for each in seen
    )
    assert repr(first) == repr(second)


def test_the_slow_path_keeps_the_limits_of_the_axes() -> None:
    _, seen = follow("kind: slow, share: 0.07")
    commands = [record.robots[0].axes[0].command for record in seen.records]
    places = [command for command in commands if math.isfinite(command)]
    steps = [b - a for a, b in itertools.pairwise(places)]
    changes = [(b - a) * RATE * RATE for a, b in itertools.pairwise(steps)]
    assert max(map(abs, changes)) <= 1.0 * (1.0 + 1e-9)


@pytest.mark.parametrize(
    "fault",
    [
        "kind: scaled, share: 0.0",
        pytest.param("kind: stall", marks=pytest.mark.campaign),
        "kind: slow, share: 0.02",
    ],
)
def test_a_body_that_does_not_come_along_is_a_fault(fault: str) -> None:
    report, seen = follow(fault)
    assert report.exit_code == 3
    assert report.robots["f0"]["fault"] == Fault.DOES_NOT_FOLLOW
    assert path_events(seen) == [("f0.left", False)]
    at = report.robots["f0"]["axes"]["left_mm"]
    assert abs(at["difference"]) < 4.0


def test_robots_of_one_trajectory_are_slowed_together() -> None:
    loaded = load(2, options="faults:\n  - {at_s: 1.0, axis: f0.left, kind: slow, share: 0.07}\n")
    rows = WAY.splitlines()
    head = rows[0] + ",f1.x_mm,f1.y_mm"
    text = "\n".join([head, *(f"{row},50,{75 + k}" for k, row in enumerate(rows[1:]))]) + "\n"
    report = run_virtual(loaded, RATE, read_trajectory(io.StringIO(text), "way", loaded.driven))
    assert report.exit_code == 0
    assert all(robot["tip_error_max_mm"] < 1e-9 for robot in report.robots.values())


def test_a_move_is_slowed_as_well() -> None:
    ended: list[Any] = []
    for share in (1.0, 0.07):
        slow = f"faults:\n  - {{at_s: 1.4, axis: f0.left, kind: slow, share: {share}}}\n"
        text = fingers(1, options=slow).replace("velocity_mm_s: 100", "velocity_mm_s: 15")
        loaded = parse_robot_file(text, "slow.yaml")
        seen = Collector(loaded)
        orders: dict[int, list[Message]] = {300: [Goto("f0", Target(actuation=(0.07, 0.05)))]}
        run_virtual(loaded, RATE, None, sinks=[seen], orders=orders, ticks=1000)
        (end,) = [event for event in seen.events if event["event"] == "goto"]
        ended.append((end["arrived"], end["tick"], path_events(seen)))
    assert [each[0] for each in ended] == [True, True]
    assert ended[1][1] > ended[0][1] + 10
    assert (ended[0][2], ended[1][2][0]) == ([], ("f0.left", False))


def test_a_slowed_run_replays_to_the_bit_and_by_older_rules_does_not(tmp_path: Path) -> None:
    loaded = load(1, options="faults:\n  - {at_s: 1.0, axis: f0.left, kind: slow, share: 0.07}\n")
    way = read_trajectory(io.StringIO(WAY), "way", loaded.driven)
    session = Session(record_virtual(tmp_path / "slowed.mcap", loaded, way))
    again = replay(session, session.robot_file())
    assert again.ticks > 900
    assert (again.divergence, again.stopped) == (None, "")
    session.motion_rules = 2
    assert replay(session, session.robot_file()).divergence is not None


def test_the_terminal_shows_it() -> None:
    event = PathSlowed(tick=1, robot="f0", axis="f0.left", over=True, lost_s=0.5, message="follows again")
    assert event_text(event) == "f0: follows again"


@pytest.mark.parametrize("seed", [26, pytest.param(38, marks=pytest.mark.campaign)])
def test_points_on_a_slowed_path_keep_the_acceleration_and_one_and_a_half_of_the_jerk(seed: int) -> None:
    """Random points amid earlier ways, while a body lags: by motion rules 5 the jerk is 7.5 and 2.7 of it."""
    random = Random(seed)
    play_deg, share = random.choice([8, 12, 15]), random.choice([0.15, 0.2, 0.3])
    kind = random.choice([f"kind: play, by_deg: {play_deg}", f"kind: slow, share: {share}"])
    loaded = load(2, options=f"faults:\n  - {{at_s: 0.4, axis: f0.left, {kind}, for_s: 3}}\n")
    orders: dict[int, list[Message]] = {}
    for k in range(7):
        tick = 100 + 110 * k + random.randrange(60)
        orders[tick] = [
            Goto(f"f{n}", Target(tip_m=(random.uniform(low, high), random.uniform(0.07, 0.085), 0.0)))
            for n, (low, high) in enumerate(((0.03, 0.06), (0.04, 0.07)))
        ]
    seen = Collector(loaded)
    run_virtual(loaded, RATE, None, sinks=[seen], orders=orders, ticks=900)
    assert path_events(seen)
    for index, config in enumerate(build_robot_configs(loaded, RATE)):
        records = [record.robots[index] for record in seen.records]
        for four in zip(*(records[k:] for k in range(4)), strict=False):
            limited = any(axis.limits for each in four for axis in each.axes)
            if limited or any(each.mode != Mode.APPROACH for each in four):
                continue
            for axis, (limit, jerk) in enumerate(zip(config.limits, config.jerk, strict=True)):
                a, b, c, d = (each.axes[axis].command for each in four)
                assert abs(d - 2.0 * c + b) <= limit.change * (1.0 + 1e-9)
                assert abs(d - 3.0 * c + 3.0 * b - a) <= 1.5 * jerk / RATE**3 * (1.0 + 1e-6)
