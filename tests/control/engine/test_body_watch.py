"""A body that does not do what its commands should make it do is a fault and no success."""

from __future__ import annotations

import io
import math
import random
import time
from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from contid.control.engine.messages import Goto, Message
from contid.control.engine.report import RunReport
from contid.control.engine.robots import Robots
from contid.control.engine.tick_costs import TickCosts
from contid.control.engine.virtual import run_virtual
from contid.control.engine.watch.arrivals import Arrivals
from contid.control.engine.watch.settling import AxisPlace, Settling, has_arrived
from contid.control.engine.watch.tip_watch import TipPath
from contid.control.engine.watch.watched_body import WatchedBody
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.faults import Fault
from contid.control.tick.follow.expected_range import AxisResponse, ExpectedRange
from contid.control.tick.supervisor import Mode
from contid.hal import Sample
from contid.robot_file.load import LoadedFile, find_robot_file, load_robot_file, parse_robot_file
from contid.targets import Target
from contid.trajectory.read import read_trajectory
from contid_drivers.sim.bus import SimBus
from contid_drivers.sim.options import FaultKind, ScheduledFault
from tests.support.fingers import Collector, fingers, load
from tests.support.sim_faults import with_faults

RATE = 200.0
WAY = "t_s,f0.x_mm,f0.y_mm\n0,50,75\n1,40,75\n3,60,85\n4,60,85\n"


def faulty(fault: str, **keys: Any) -> LoadedFile:
    """A finger with one fault from 1.5 s on."""
    return load(1, options=f"faults:\n  - {{at_s: 1.5, axis: f0.left, {fault}}}\n", **keys)


def follow(loaded: LoadedFile, rows: str = WAY, **keys: Any) -> RunReport:
    return run_virtual(loaded, RATE, read_trajectory(io.StringIO(rows), "way", loaded.driven), **keys)


@pytest.mark.parametrize(
    "fault",
    [
        "kind: scaled, share: 0.0",  # the encoder is frozen
        "kind: scaled, share: 0.33",  # the horn slipped, or another pinion
        "kind: scaled, share: -1.0",  # the sign is wrong
        "kind: swapped, other: f0.right",
        "kind: play, by_deg: 40",
        "kind: slow, share: 0.01",
        "kind: stall",
    ],
)
def test_a_robot_that_does_not_follow_is_a_fault(fault: str) -> None:
    report = follow(faulty(fault))
    assert report.exit_code == 3
    asked = (
        (Fault.DOES_NOT_FOLLOW,) if "swapped" not in fault else (Fault.DOES_NOT_FOLLOW, Fault.MOVES_UNASKED)
    )
    assert report.robots["f0"]["fault"] in asked
    assert "is measured at" in report.robots["f0"]["message"]
    assert "mm, commanded " in report.robots["f0"]["message"]


def test_a_sound_robot_is_none() -> None:
    report = follow(load(1))
    assert report.exit_code == 0
    axes = report.robots["f0"]["axes"]
    assert list(axes) == ["left_mm", "right_mm"]
    assert all(abs(at["measured"] - at["commanded"]) < 0.1 for at in axes.values())


@pytest.mark.parametrize("share", [pytest.param(0.0, marks=pytest.mark.campaign), 0.8])
def test_a_hose_that_is_off_is_a_fault(share: float) -> None:
    leak = ScheduledFault(at_s=1.5, kind=FaultKind.LEAK, axis="arm.s1.p1", share=share)
    loaded = with_faults(load_robot_file(find_robot_file("stiffflop2")), [leak])
    rows = "t_s,s1.p1_bar,s1.p2_bar,s1.p3_bar,s2.p1_bar,s2.p2_bar,s2.p3_bar\n"
    rows += "".join(f"{t},{0.6 + 0.1 * (t % 2)},0.2,0.2,0.3,0.3,0.3\n" for t in range(5))
    report = follow(loaded, rows)
    assert report.exit_code == 3
    assert report.robots["arm"]["fault"] in (Fault.DOES_NOT_FOLLOW, Fault.MOVES_UNASKED)
    assert "arm.s1.p1 is measured at" in report.robots["arm"]["message"]


@pytest.mark.parametrize("turns", [50.0, -50.0])
def test_a_jump_in_hold_is_an_implausible_sample(turns: float) -> None:
    loaded = faulty(f"kind: jump, by_deg: {turns * 57.3}")
    report = run_virtual(loaded, RATE, None, ticks=350)
    assert report.robots["f0"]["fault"] == Fault.IMPLAUSIBLE_SAMPLE
    assert "jumped from" in report.robots["f0"]["message"]


@pytest.mark.parametrize("by_deg", [12.0, -20.0])
def test_a_shaft_that_moves_at_a_still_command_moves_unasked(by_deg: float) -> None:
    report = run_virtual(faulty(f"kind: jump, by_deg: {by_deg}"), RATE, None, ticks=350)
    assert report.robots["f0"]["fault"] == Fault.MOVES_UNASKED


def test_a_sample_from_the_future_is_implausible(monkeypatch: pytest.MonkeyPatch) -> None:
    exchange = SimBus.exchange

    def ahead(self: SimBus, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        samples = exchange(self, commands)
        if self._clock.now() < 1.0:
            return samples
        return {axis: replace(sample, time_s=sample.time_s + 1e6) for axis, sample in samples.items()}

    monkeypatch.setattr(SimBus, "exchange", ahead)
    report = run_virtual(load(1), RATE, None, ticks=350)
    assert report.robots["f0"]["fault"] == Fault.IMPLAUSIBLE_SAMPLE
    assert "in the future" in report.robots["f0"]["message"]


@pytest.mark.parametrize("kind", ["every other sample", "two of three", "30 ms old", "80 ms old"])
def test_an_encoder_that_is_frozen_is_found_whatever_its_adapter_does(
    monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """The left encoder stands still from 1.5 s on, in some samples or with an age in all of them."""
    exchange, age_s = SimBus.exchange, {"30 ms old": 0.03, "80 ms old": 0.08}.get(kind, 0.0)
    often = {"every other sample": 2, "two of three": 3}.get(kind, 1)
    frozen: list[Sample] = []
    past: list[Mapping[str, Sample]] = []

    def damaged(self: SimBus, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        past.append(exchange(self, commands))
        old = past[max(len(past) - 1 - round(age_s * RATE), 0)]
        seen = {axis: replace(sample, age_s=sample.age_s + age_s) for axis, sample in old.items()}
        if self._clock.now() > 1.5:
            frozen.append(seen["f0.left"])
            if often == 1 or len(past) % often:
                seen["f0.left"] = replace(seen["f0.left"], value=frozen[0].value)
        return seen

    monkeypatch.setattr(SimBus, "exchange", damaged)
    slow = "t_s,f0.left_mm,f0.right_mm\n0,50,50\n1.2,50,50\n2.2,53,50\n3.2,50,50\n"
    report = follow(load(1), slow)
    assert report.exit_code == 3
    assert report.robots["f0"]["fault"] in (Fault.DOES_NOT_FOLLOW, Fault.MOVES_UNASKED)
    assert "f0.left" in report.robots["f0"]["message"]


@pytest.mark.parametrize("age_s", [0.03, 0.08])
def test_a_sound_robot_whose_samples_are_old_is_none(monkeypatch: pytest.MonkeyPatch, age_s: float) -> None:
    exchange = SimBus.exchange
    past: list[Mapping[str, Sample]] = []

    def late(self: SimBus, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        past.append(exchange(self, commands))
        old = past[max(len(past) - 1 - round(age_s * RATE), 0)]
        return {axis: replace(sample, age_s=sample.age_s + age_s) for axis, sample in old.items()}

    monkeypatch.setattr(SimBus, "exchange", late)
    assert follow(load(1), "t_s,f0.left_mm,f0.right_mm\n0,50,50\n1,90,10\n2,50,50\n3,90,10\n").exit_code == 0


def goto(loaded: LoadedFile) -> tuple[RunReport, dict[str, Any]]:
    """A move of the finger by 10 mm at its start, and its end."""
    seen = Collector(loaded)
    orders: dict[int, list[Message]] = {300: [Goto("f0", Target(actuation=(0.06, 0.05)))]}
    report = run_virtual(loaded, RATE, None, sinks=[seen], orders=orders, ticks=550)
    (ended,) = [event for event in seen.events if event["event"] == "goto"]
    return report, ended


def test_a_move_ends_when_the_measured_robot_is_there() -> None:
    report, ended = goto(load(1))
    assert ended["arrived"]
    assert ended["message"] == ""
    at = report.robots["f0"]["axes"]["left_mm"]
    assert at["commanded"] == pytest.approx(60.0)
    assert at["measured"] == pytest.approx(60.0, abs=0.1)


def test_a_move_whose_robot_is_not_there_did_not_arrive() -> None:
    report, ended = goto(faulty("kind: scaled, share: 0.5"))
    assert not ended["arrived"]
    assert report.robots["f0"]["fault"] == Fault.DOES_NOT_FOLLOW


def test_a_slow_robot_has_time_to_arrive() -> None:
    """Healthy by the lag of its file, it is 3 mm behind when its command is at the target."""
    slow = "response_ms: 200, mm_per_rev"
    text = fingers(1).replace("mm_per_rev", slow).replace("rest_mm:", "follow_lag_ms: 300\n    rest_mm:")
    loaded = parse_robot_file(text, "slow.yaml")
    _, ended = goto(loaded)
    assert ended["arrived"]
    _, quick = goto(load(1))
    assert ended["tick"] > quick["tick"] + 20
    report = follow(loaded, "t_s,f0.x_mm,f0.y_mm\n0,50,75\n1,40,75\n")
    assert report.exit_code == 0
    assert all(abs(at["difference"]) < 1.0 for at in report.robots["f0"]["axes"].values())


def test_the_response_of_an_axis_is_its_own_else_that_of_the_robot() -> None:
    own = "follow_lag_ms: 30, follow_delay_ms: 5, mm_per_rev"
    text = fingers(1).replace("mm_per_rev", own, 1).replace("rest_mm:", "follow_lag_ms: 70\n    rest_mm:")
    (config,) = build_robot_configs(parse_robot_file(text, "own.yaml"), RATE)
    left, right = config.responses
    assert (left.lag_s, left.delay_s) == pytest.approx((0.03, 0.005))
    assert (right.lag_s, right.delay_s) == pytest.approx((0.07, 0.02))


@pytest.mark.parametrize(("least_ms", "exit_code"), [(0.0, 0), (30.0, 3)])
def test_a_device_that_returns_its_commands_is_quicker_than_any(least_ms: float, exit_code: int) -> None:
    """Only a lag that was identified shows it: the measurement is the command of the tick before."""
    text = fingers(1).replace("mm_per_rev", "response_ms: 0, mm_per_rev")
    text = text.replace("mm_per_rev", f"follow_least_lag_ms: {least_ms}, mm_per_rev")
    text = text.replace("rest_mm:", "follow_mm: 0.4\n    rest_mm:")
    report = follow(
        parse_robot_file(text, "echo.yaml"), "t_s,f0.left_mm,f0.right_mm\n0,50,50\n0.4,75,50\n1,75,50\n"
    )
    assert report.exit_code == exit_code


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.campaign) for k in (1, 2))])
def test_every_axis_that_is_no_quicker_and_no_slower_stays_inside(seed: int) -> None:
    """First-order axes with random dead times and lags, solved exactly between the ticks."""
    draw, period_s = random.Random(seed), 0.005
    response = AxisResponse(1.0, 0.02, 0.04, math.inf, 1.0, least_delay_s=0.01, least_lag_s=0.015)
    expected = ExpectedRange([response], period_s)
    axes = [(draw.choice([0.01, 0.015, 0.02]), draw.uniform(0.015, 0.04)) for _ in range(20)]
    at, command, commands = [0.0] * len(axes), 0.0, [0.0] * 5
    expected.begin((0.0,), (0.0,))
    narrow = 0
    for tick in range(2000):
        command += draw.uniform(-1.0, 1.0) if tick // 100 % 2 else 0.0
        commands.append(command)
        expected.advance((command,))
        for k, (delay_s, lag_s) in enumerate(axes):
            goal = commands[-1 - round(delay_s / period_s)]
            at[k] = goal + (at[k] - goal) * math.exp(-period_s / lag_s)
            assert expected.excess(0, at[k]) < 1e-9
        narrow += expected.excess(0, command) > 0.1
    assert narrow > 200


def test_less_than_the_tolerance_is_no_fault() -> None:
    """9 degrees of play are 0.94 mm of rack."""
    assert follow(faulty("kind: play, by_deg: 9")).exit_code == 0


def test_the_tolerance_is_that_of_the_robot_file() -> None:
    text = fingers(1, options="faults:\n  - {at_s: 1.5, axis: f0.left, kind: play, by_deg: 40}\n")
    loaded = parse_robot_file(text.replace("    rest_mm:", "    follow_mm: 5\n    rest_mm:"), "f.yaml")
    assert follow(loaded).exit_code == 0


def test_late_answers_and_noise_are_no_fault() -> None:
    """Adapters that are late by 3 to 16 ms, changing all the time."""
    draw = random.Random(7)
    faults = "".join(
        f"  - {{at_s: {0.05 * k}, kind: late, delay_ms: {draw.uniform(3, 16):.2f}, for_s: 0.05}}\n"
        for k in range(20, 90)
    )
    assert follow(load(1, options="faults:\n" + faults)).exit_code == 0


@pytest.mark.parametrize(("fault", "exit_code"), [("play, by_deg: 9", 3), ("jump, by_deg: 0.1", 0)])
def test_axes_that_lag_differently_bend_the_arm_elsewhere(fault: str, exit_code: int) -> None:
    """Each rack is within its 1 mm; the tip is not within the 2 mm of the file."""
    text = fingers(1, options=f"faults:\n  - {{at_s: 1.5, axis: f0.left, kind: {fault}}}\n")
    report = follow(
        parse_robot_file(text.replace("    rest_mm:", "    follow_tip_mm: 2\n    rest_mm:"), "f.yaml")
    )
    assert report.exit_code == exit_code
    if exit_code:
        assert report.robots["f0"]["fault"] == Fault.DOES_NOT_FOLLOW
        assert "the tip of the measured axes is 2." in report.robots["f0"]["message"]


def test_a_tip_is_measured_from_the_way_of_the_newest_commands() -> None:
    path = TipPath([AxisResponse(1.0, 0.02, 0.02, 1.0, 1.0)], 0.01)
    assert path.distance((1.0, 2.0, 3.0)) == 0.0
    for x in range(30):
        path.tips.append((float(x), 0.0, 0.0))
    oldest = 30.0 - len(path.tips)
    assert path.distance((26.5, 0.0, 0.0)) == 0.0
    assert path.distance((26.5, 3.0, 4.0)) == pytest.approx(5.0)
    assert path.distance((oldest - 2.0, 0.0, 0.0)) == pytest.approx(2.0)
    assert 8 <= len(path.tips) <= 12


def test_an_axis_that_is_not_there_has_not_arrived_by_a_missed_read() -> None:
    """Neither for a goto, nor for the report of a run that ends in that tick or while it settles."""
    (config,) = build_robot_configs(load(1), RATE)
    there, far = (Sample(value, time_s=0.0, valid=True, age_s=0.0) for value in (8.0, 2.0))
    missed = replace(far, valid=False)
    body = WatchedBody(config)
    body.command((8.0, 8.0), [there, far])
    settling = Settling(body)
    settling.goal = body.device
    assert [has_arrived(settling.places([there, each])) for each in (far, missed, there)] == [
        False,
        False,
        True,
    ]
    for samples in ([there, missed], [there, replace(missed, value=None)]):
        settling.leave(samples, holds=True, now_s=1.0)
        assert settling.until_s is not None
        settling.settle(samples, 1.0)
        assert settling.until_s is not None
    settling.settle([there, far], 1.1)
    settling.settle([there, replace(missed, value=None)], 10.0)
    assert settling.until_s is None
    assert settling.last is not None
    assert not has_arrived(settling.last)


@pytest.mark.parametrize(("mode", "arrived"), [(Mode.HOLD, True), (Mode.FAULT, False)])
def test_a_goto_has_not_arrived_in_fault(mode: Mode, arrived: bool) -> None:
    configs, collector = build_robot_configs(load(1), RATE), Collector()
    robots = Robots(configs, collector, TickCosts(time.monotonic, 1, ()))
    robots.states[0] = replace(robots.states[0], mode=mode)
    places = [AxisPlace("left_mm", 1.0, 1.0, arrived=True)]
    watch = SimpleNamespace(places=lambda index: places, settlings=[Settling(WatchedBody(configs[0]))])
    arrivals = Arrivals(robots, watch, collector)  # type: ignore[arg-type]
    arrivals.commanded(0)
    arrivals.settle(1.0)
    assert [event["arrived"] for event in collector.events] == [arrived]
