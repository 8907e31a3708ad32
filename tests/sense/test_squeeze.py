"""Moves until a force: a simulated finger with dry friction closes on an elastic object and holds it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from contid.control.engine import messages as msg
from contid.control.engine.events.robots import ContactBegan, GotoEnded, OrderRefused, SqueezeChanged
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.squeezing import Squeeze
from contid.control.tick.supervisor import Mode
from contid.robot_file.load import parse_robot_file
from contid.session.read import Session
from contid.targets import Target
from contid_contact.squeeze_way import moved
from contid_dynamics.finger_body import FingerBody
from contid_sessions.replay.replay import replay
from tests.sense.squeeze_runs import AT_CLOSE, BEFORE, BEHIND, RATE_HZ, Run, closing, hand, hand_text, run
from tests.session.runs import record_virtual

GOAL_N = 3.0


def ends(found: Run) -> list[str]:
    return [event.what for event in found.events if isinstance(event, SqueezeChanged)]


def arrived(found: Run) -> bool:
    return [event.arrived for event in found.events if isinstance(event, GotoEnded)][-1]


@pytest.mark.parametrize(
    ("stiffness", "friction"),
    [
        pytest.param(0.5, 0.8, marks=pytest.mark.campaign),
        (0.5, 1.2),
        pytest.param(3.0, 1.0, marks=pytest.mark.campaign),
        (50.0, 0.8),
        pytest.param(50.0, 1.2, marks=pytest.mark.campaign),
    ],
)
def test_the_object_feels_the_force_asked_for_and_no_more(stiffness: float, friction: float) -> None:
    found = run(hand(stiffness), closing(GOAL_N), 8.0, friction)
    assert ends(found) == ["reached"]
    assert arrived(found)
    last = np.array(found.push_n[-400:])
    # A fifth of the friction of 60 mA is 12 mA, and 20 mA are 1 N here.
    assert np.abs(last - GOAL_N).max() < 0.2 * GOAL_N
    assert max(found.push_n) < 1.2 * GOAL_N
    assert found.states[-1].mode is Mode.HOLD
    # It stands: nothing oscillates between friction and integral.
    assert np.ptp(found.commands[-400:], axis=0).max() < 2e-5


def test_every_step_is_within_the_limits_and_the_approach_within_the_jerk() -> None:
    (config, _) = build_robot_configs(hand(3.0), RATE_HZ)
    found = run(hand(3.0), closing(GOAL_N))
    commands = found.commands
    steps = np.diff(commands, axis=0)
    for axis, limits in enumerate(config.limits):
        assert (np.abs(steps[:, axis]) <= limits.step * (1.0 + 1e-9)).all()
        assert (np.abs(np.diff(steps[:, axis])) <= limits.change * (1.0 + 1e-9)).all()
        assert ((commands[:, axis] >= limits.lower) & (commands[:, axis] <= limits.upper)).all()
    first = len(commands) - len(found.states) + AT_CLOSE
    jerk = np.diff(commands[first - 5 : first + 200], n=3, axis=0) * RATE_HZ**3
    assert np.abs(jerk).max() < 1.1 * config.jerk[0]
    free = slice(first + 100, first + 200)
    tips = np.array([config.model.forward(tuple(each)).tip_m for each in commands[free]])
    speeds = np.linalg.norm(np.diff(tips, axis=0), axis=1) * RATE_HZ
    assert speeds == pytest.approx(5e-3, rel=1e-2)


def test_no_sequence_of_forces_exceeds_the_jerk() -> None:
    (config, _) = build_robot_configs(hand(3.0), RATE_HZ)
    random = np.random.default_rng(4)
    squeeze = Squeeze(GOAL_N, (0.06, 0.06), (0.01, -0.005), share=0.5)
    shares, goal = [], 0.0
    for _ in range(20_000):
        if random.random() < 0.3:
            goal = float(random.normal(0.0, 0.5))
        squeeze = moved(config, squeeze, goal)
        shares.append(squeeze.share)
    jerk = np.abs(np.diff(shares, n=3)) * RATE_HZ**3 * max(map(abs, squeeze.way))
    assert min(shares) > 0.0
    assert max(shares) < 1.0
    assert jerk.max() <= config.jerk[0] * (1.0 + 1e-6)


def test_an_object_that_is_taken_away_is_an_event_and_the_finger_stays() -> None:
    found = run(hand(3.0, until_s=4.0), closing(GOAL_N))
    assert ends(found) == ["reached", "lost"]
    assert found.states[-1].squeeze is None
    assert found.states[-1].mode is Mode.HOLD
    assert np.ptp(found.commands[-100:], axis=0).max() == 0.0


@pytest.mark.parametrize(
    "order", [msg.Hold(), pytest.param(msg.Resume(), marks=pytest.mark.campaign), msg.Stop(), msg.Estop()]
)
def test_any_order_releases_the_force(order: msg.Message) -> None:
    found = run(hand(3.0), closing(GOAL_N, {750: [order]}))
    assert ends(found) == ["reached"]
    assert found.states[740].squeeze is not None
    assert found.states[800].squeeze is None
    assert np.ptp(found.commands[-150:], axis=0).max() == 0.0


def test_an_order_during_the_closing_ends_it() -> None:
    found = run(hand(3.0), closing(GOAL_N, {300: [msg.Hold()]}), seconds=2.5)
    assert ends(found) == []
    assert not arrived(found)
    assert max(found.push_n) == 0.0
    found = run(hand(3.0), closing(GOAL_N, {300: [msg.Goto("left", BEFORE)]}), seconds=4.0)
    assert ends(found) == []
    assert found.states[-1].squeeze is None
    assert arrived(found)


def test_a_second_force_on_the_way_closes_again() -> None:
    found = run(hand(3.0), closing(GOAL_N, {300: [msg.Goto("left", BEHIND, 4.0)]}))
    assert ends(found) == ["reached"]
    assert found.push_n[-1] == pytest.approx(4.0, rel=0.15)


def test_no_object_up_to_the_target_is_no_arrival() -> None:
    found = run(hand(None), closing(GOAL_N), 8.0)
    assert ends(found) == ["nothing"]
    assert not arrived(found)
    model = build_robot_configs(hand(None), RATE_HZ)[0].model
    assert math.dist(model.forward(found.states[-1].command).tip_m, BEHIND.tip_m or ()) < 5e-5


def test_a_force_that_friction_hides_and_a_begin_in_contact_are_reported() -> None:
    weak = run(hand(3.0), closing(0.3))
    assert ends(weak) == ["weak"]
    assert not arrived(weak)
    inside = Target(tip_m=(0.042, 0.075, 0.0))
    again = run(
        hand(3.0), closing(5.0, {AT_CLOSE: [msg.Goto("left", inside)], 400: [msg.Goto("left", BEHIND, 5.0)]})
    )
    assert ends(again) == ["pressed"]
    assert again.push_n[390] > 1.0
    assert max(again.push_n) < 10.0


def test_another_force_while_it_holds_is_refused_and_the_first_one_stays() -> None:
    found = run(hand(3.0), closing(GOAL_N, {750: [msg.Goto("left", BEHIND, 5.0)]}))
    assert ends(found) == ["reached"]
    refused = [event.message for event in found.events if isinstance(event, OrderRefused)]
    assert refused == ["left: it holds an object; move back from it first"]
    assert found.push_n[-1] == pytest.approx(GOAL_N, rel=0.15)


@pytest.mark.parametrize(
    ("sense", "target", "message"),
    [
        ("", BEHIND, "nm_per_a"),
        ("{contact: hold, usual_ma: 200, contact_ma: 100}", BEHIND, "nm_per_a"),
        (None, Target(tip_m=(0.031, 0.075, 0.0)), "1.0 mm from the target, 3 mm"),
    ],
)
def test_what_cannot_be_done_is_refused(sense: str | None, target: Target, message: str) -> None:
    loaded = hand(3.0) if sense is None else hand(3.0, sense=sense)
    orders = {**closing(1.0), AT_CLOSE: [msg.Goto("left", target, 1.0)]}
    found = run(loaded, orders, 1.0)
    refused = [event.message for event in found.events if isinstance(event, OrderRefused)]
    assert len(refused) == 1
    assert message in refused[0]
    assert not any(state.squeeze for state in found.states)


def test_the_contact_at_its_object_starts_no_policy() -> None:
    loaded = hand(50.0, sense="{contact: retract, usual_ma: 120, contact_ma: 60, nm_per_a: 0.354}")
    found = run(loaded, closing(6.0))
    contacts = [event.policy for event in found.events if isinstance(event, ContactBegan)]
    assert "ignore" in contacts
    assert ends(found) == ["reached"]


def test_it_replays_bit_for_bit(tmp_path: Path) -> None:
    path = record_virtual(tmp_path / "s.mcap", hand(3.0, until_s=4.0), None, closing(GOAL_N), ticks=900)
    session = Session(path)
    kinds = [event.what for event in session.events() if isinstance(event, SqueezeChanged)]
    assert kinds == ["reached", "lost"]
    result = replay(session, session.robot_file())
    assert (result.divergence, result.stopped) == (None, "")
    assert result.ticks == 900


def test_the_simulated_finger_is_in_balance_within_its_friction() -> None:
    loaded = parse_robot_file(hand_text(3.0), "hand.yaml")
    robot = loaded.file.robots["left"]
    body = FingerBody("left", robot)  # type: ignore[arg-type]
    (config, _) = build_robot_configs(loaded, RATE_HZ)
    rng = np.random.default_rng(22)
    free = np.array(config.transmission.to_device((0.05, 0.06)))
    pushed = 0
    for _ in range(300):
        free += rng.uniform(-0.15, 0.2, 2)
        shafts, currents = (np.array(part) for part in zip(*body.settle(list(free), 0.0), strict=True))
        at = config.transmission.to_actuation(tuple(shafts))
        tip = np.array(config.model.forward(at).tip_m)
        assert np.array(body.tip_mm(list(shafts))) == pytest.approx(1e3 * tip[:2], abs=1e-6)
        push_n = 3e3 * max(0.0, tip[0] - 0.040)
        assert body.push_n == pytest.approx(push_n, rel=1e-3, abs=1e-3)
        for i in range(2):
            step = np.zeros(2)
            step[i] = 1e-5
            x = [
                config.model.forward(config.transmission.to_actuation(tuple(shafts + s))).tip_m[0]
                for s in (-step, step)
            ]
            load_a = push_n * (x[1] - x[0]) / 2e-5 / 0.354
            assert abs(currents[i] - load_a) < 0.060 + 1e-3 + 5e-3 * abs(load_a)
        pushed += push_n > 0.0
        free = np.clip(free, 0.0, 15.0)
    assert 20 < pushed < 300
