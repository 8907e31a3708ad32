"""Policies: files of other robots are refused, and garbage, silence and refusals hold within all limits."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest

from contid import Robot, Sim
from contid.errors import ContidError
from contid.remote.client.servo import ServoState
from contid_learn import Policy, PolicyAbout, write_policy
from contid_learn.drive import load_drive
from contid_learn.goals import parse_goal
from contid_learn.policy_loop import PolicyLoop
from contid_learn.views import RobotView, views_of

RATE_HZ = 20.0
GOAL = {"finger": np.array([30.0, 85.0])}


def views(name: str = "finger") -> tuple[RobotView, ...]:
    return views_of(Robot(name), RATE_HZ)


def about() -> PolicyAbout:
    return PolicyAbout.of(views(), RATE_HZ, "reach")


def written(path: Path, gain: float = 1.0) -> Path:
    """A policy that goes where the goal is: more of both axes for y, apart for x."""
    weights = np.zeros((2, 10))
    weights[:, 6:8] = gain * np.array([[-1.0, 1.0], [1.0, 1.0]])
    write_policy(path, about(), [(weights, np.zeros(2))])
    return path


def telemetry(sim: Sim) -> dict[str, Any]:
    state = sim.state
    return {
        name: {"measured": robot.measured.tolist(), "tip_mm": robot.tip.tolist(), "state": robot.mode}
        for name, robot in state.robots.items()
    }


def test_a_file_answers_as_its_numbers_state(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    one, two = rng.normal(size=(5, 10)), rng.normal(size=(2, 5))
    biases = rng.normal(size=5), rng.normal(size=2)
    write_policy(tmp_path / "p.onnx", about(), [(one, biases[0]), (two, biases[1])])
    policy = Policy(tmp_path / "p.onnx")
    seen = rng.normal(size=10).astype(np.float32)
    by_hand = np.tanh(two @ np.tanh(one @ seen + biases[0]) + biases[1])
    assert np.allclose(policy(seen), by_hand, atol=1e-5)
    assert policy.about == about()


def test_a_simple_law_reaches_the_goal_through_the_loop(tmp_path: Path) -> None:
    loop = PolicyLoop(views(), Policy(written(tmp_path / "p.onnx", gain=6.0)), GOAL, 1.0 / RATE_HZ)
    with loop, Sim("finger") as sim:
        for step in range(120):
            row = loop(ServoState(step, step / RATE_HZ, telemetry(sim), sim.state.tick, ""))
            assert row is not None
            sim.step(row, ticks=10)
        assert np.linalg.norm(sim.state["finger"].tip - GOAL["finger"]) < 3.0


class Garbage:
    """Answers of every kind that a broken network gives."""

    def __init__(self, axes: int) -> None:
        self._rng, self._axes = np.random.default_rng(1), axes

    def __call__(self, _observed: Any) -> Any:
        kind = self._rng.integers(5)
        if kind == 0:
            return np.full(self._axes, self._rng.choice([math.nan, math.inf, -math.inf]))
        if kind == 1:
            return self._rng.choice([-1e300, 1e300, -1.0, 1.0], self._axes)
        if kind == 2:
            return np.where(self._rng.random(self._axes) < 0.5, math.nan, 1.0)
        return self._rng.normal(0.0, 10.0 ** self._rng.integers(-3, 4), self._axes)


def violations_of_garbage(name: str, steps: int) -> tuple[int, int]:
    """Ticks whose commands exceed position, velocity or acceleration of the robot file; and ticks."""
    robots = Robot(name)
    seen = views_of(robots, RATE_HZ)
    of_file = {view.name: view.robot.limits for view in seen}
    goals = {view.name: view.reachable.tips[0] for view in seen}
    loop = PolicyLoop(seen, Garbage(sum(len(v.columns) for v in seen)), goals, 1.0)
    wrong = ticks = 0
    with loop, Sim(name) as sim:
        before: dict[str, Any] = {}
        for step in range(steps):
            refused = "; ".join(robot.refused for robot in sim.state.robots.values() if robot.refused)
            row = loop(ServoState(step, step / 100.0, telemetry(sim), sim.state.tick, refused))
            assert row is not None
            assert all(map(math.isfinite, row.values()))
            for tick in range(2):
                state = sim.step(row if tick == 0 else None)
                ticks += 1
                for view in seen:
                    limits, at = of_file[view.name], state[view.name].command
                    last, speed = before.get(view.name, (at, np.zeros(len(at))))
                    now = (at - last) * sim.rate_hz
                    change = (now - speed) * sim.rate_hz
                    wrong += bool(
                        (at < limits.min - 1e-9).any()
                        or (at > limits.max + 1e-9).any()
                        or (np.abs(now) > limits.velocity * (1 + 1e-6)).any()
                        or (np.abs(change) > limits.acceleration * (1 + 1e-4)).any()
                    )
                    before[view.name] = (at, now)
        assert all(robot.fault == 0 for robot in sim.state.robots.values())
    assert loop.counts.not_finite > steps // 10
    return wrong, ticks


def test_garbage_exceeds_no_limit() -> None:
    assert violations_of_garbage("finger", 1000) == (0, 2000)


@pytest.mark.slow
def test_garbage_exceeds_no_limit_of_a_hand_beside_itself() -> None:
    assert violations_of_garbage("hand", 150) == (0, 300)


@pytest.mark.campaign
def test_garbage_of_ten_thousand_steps_exceeds_no_limit() -> None:
    assert violations_of_garbage("finger", 10_000) == (0, 20_000)


@pytest.mark.campaign
@pytest.mark.timeout(14_400)
def test_garbage_of_a_million_steps_exceeds_no_limit() -> None:
    assert violations_of_garbage("finger", 1_000_000) == (0, 2_000_000)


def test_a_stale_answer_is_never_used() -> None:
    def slow(_observed: Any) -> Any:
        time.sleep(0.08)
        return np.ones(2)

    loop = PolicyLoop(views(), slow, GOAL, 0.02)
    with loop, Sim("finger") as sim:
        rows = []
        for step in range(12):
            rows.append(loop(ServoState(step, step * 0.02, telemetry(sim), 0, "")))
            time.sleep(0.008)
    assert loop.counts.used == 0
    assert loop.counts.stale == 12
    assert all(row == rows[0] for row in rows)


def test_a_refused_row_leaves_the_target_where_it_was() -> None:
    loop = PolicyLoop(views(), lambda _: np.ones(2), GOAL, 1.0)
    with loop, Sim("finger") as sim:
        seen = telemetry(sim)
        first = loop(ServoState(0, 0.0, seen, 0, ""))
        again = loop(ServoState(1, 0.1, seen, 0, "out of reach"))
        further = loop(ServoState(2, 0.2, seen, 0, ""))
    assert first is not None
    assert again == first
    assert further is not None
    assert further["left_mm"] == pytest.approx(first["left_mm"] + 3.0)


def test_an_error_of_the_network_is_raised_by_the_loop() -> None:
    def broken(_observed: Any) -> Any:
        raise ContidError("the network broke")

    loop = PolicyLoop(views(), broken, GOAL, 1.0)
    with loop, Sim("finger") as sim, pytest.raises(ContidError, match="the network broke"):
        loop(ServoState(0, 0.0, telemetry(sim), 0, ""))


def changed(path: Path, **changes: Any) -> Path:
    model = onnx.load(path)
    (entry,) = model.metadata_props
    entry.value = json.dumps({**json.loads(entry.value), **changes})
    onnx.save(model, path)
    return path


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"columns": ["left_mm", "up_mm"]}, "it moves left_mm, up_mm; these robots have left_mm, right_mm"),
        ({"columns": ["left_mm"]}, "it answers 2 numbers for 1 axes"),
        ({"observation": 9}, "observation 9; this version has 1"),
        ({"rate_hz": -3}, "rate_hz -3: allowed: above 0"),
        ({"rate_hz": "fast"}, "rate_hz 'fast'"),
        ({"width": 11}, "p.onnx: "),
        ({"colour": 1}, "unexpected keyword"),
    ],
)
def test_files_that_do_not_belong_to_the_robot_are_refused(
    tmp_path: Path, changes: Mapping[str, Any], message: str
) -> None:
    path = changed(written(tmp_path / "p.onnx"), **changes)
    with pytest.raises(ContidError, match=message):
        load_drive("finger", str(path), "x_mm=30,y_mm=85")


def test_files_that_are_no_policy_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text.onnx").write_text("hello")
    with pytest.raises(ContidError, match="no ONNX file that onnxruntime can run"):
        Policy(tmp_path / "text.onnx")
    with pytest.raises(ContidError, match="no such file"):
        Policy(tmp_path / "none.onnx")
    model = onnx.load(written(tmp_path / "p.onnx"))
    del model.metadata_props[:]
    onnx.save(model, tmp_path / "bare.onnx")
    with pytest.raises(ContidError, match="metadata has no key 'contid'"):
        Policy(tmp_path / "bare.onnx")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x_mm", "'x_mm' is not COLUMN=NUMBER"),
        ("x_mm=nan", "is not COLUMN=NUMBER"),
        ("x_mm=1,x_mm=2", "x_mm is given twice"),
        ("", "'' is not COLUMN=NUMBER"),
    ],
)
def test_goals_with_mistakes_are_refused(text: str, message: str) -> None:
    with pytest.raises(ContidError, match=message):
        parse_goal(text)


def test_a_goal_names_every_column_of_its_robots(tmp_path: Path) -> None:
    file = str(written(tmp_path / "p.onnx"))
    with pytest.raises(ContidError, match="no y_mm; needed: x_mm, y_mm"):
        load_drive("finger", file, "x_mm=3")
    with pytest.raises(ContidError, match="no column z_mm for these robots"):
        load_drive("finger", file, "x_mm=3,y_mm=80,z_mm=1")
