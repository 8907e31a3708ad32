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
from contid_learn.drive import load_drive, main
from contid_learn.goals import parse_goal
from contid_learn.policy_loop import PolicyLoop
from contid_learn.views import RobotView, views_of
from tests.support.virtual.commands import Commands

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
    """Answers of every kind that a broken network gives; None: it does not answer in time."""

    def __init__(self, axes: int, seed: int = 1) -> None:
        self._rng, self._axes = np.random.default_rng(seed), axes
        self.stale = 0

    def ask(self, observed: Any, _timeout_s: float) -> Any:
        """In place of `contid_learn.policy_loop.Inference`, without its thread."""
        assert np.isfinite(observed).all()
        answer = self._answer(int(self._rng.integers(6)))
        self.stale += answer is None
        return answer

    def close(self) -> None: ...

    def _answer(self, kind: int) -> Any:
        if kind == 0:
            return np.full(self._axes, self._rng.choice([math.nan, math.inf, -math.inf]))
        if kind == 1:
            return self._rng.choice([-1e300, 1e300, -1.0, 1.0], self._axes)
        if kind == 2:
            return np.where(self._rng.random(self._axes) < 0.5, math.nan, 1.0)
        if kind == 3:
            return None
        return self._rng.normal(0.0, 10.0 ** self._rng.integers(-3, 4), self._axes)


def garbage(name: str, steps: int, seed: int = 1) -> Commands:
    """A policy of garbage drives robots as `PolicyLoop` has it, an action every second tick."""
    seen = views_of(Robot(name), RATE_HZ)
    answers = Garbage(sum(len(view.columns) for view in seen), seed)
    goals = {view.name: view.reachable.tips[0] for view in seen}
    loop = PolicyLoop(seen, lambda _: np.zeros(0), goals, 1.0)
    loop.close()
    loop._inference = answers  # type: ignore[assignment]
    with Sim(name) as sim:
        layout = sim._states.layout
        commands = Commands(sim._process.engine.robots.configs, sim.rate_hz, beside_a_body=name == "hand")
        for step in range(steps):
            refused = "; ".join(robot.refused for robot in sim.state.robots.values() if robot.refused)
            row = loop(ServoState(step, step / 100.0, telemetry(sim), sim.state.tick, refused))
            assert row is not None
            assert all(map(math.isfinite, row.values()))
            for tick in range(2):
                sim.step(row if tick == 0 else None)
                commands.take([layout.robot(sim._values, index) for index in range(len(seen))])
        commands.compare()
        assert all(robot.fault == 0 for robot in sim.state.robots.values())
    counts = loop.counts
    assert counts.not_finite > steps // 10
    assert counts.stale == answers.stale > steps // 10
    assert counts.used + counts.not_finite + counts.stale == steps
    return commands


def test_garbage_exceeds_no_limit() -> None:
    commands = garbage("finger", 1000)
    assert commands.ticks == 2000
    assert not any(commands.exceeded.values()), commands.exceeded


@pytest.mark.slow
def test_garbage_exceeds_no_limit_of_a_hand_beside_itself() -> None:
    commands = garbage("hand", 150)
    assert not any(commands.exceeded.values()), commands.exceeded


@pytest.mark.campaign
@pytest.mark.timeout(14_400)
@pytest.mark.parametrize(("name", "steps"), [("finger", 1_000_000), ("catheter", 50_000), ("cbha", 50_000)])
def test_garbage_of_many_steps_exceeds_no_limit(name: str, steps: int) -> None:
    commands = garbage(name, steps)
    assert commands.ticks == 2 * steps
    assert not any(commands.exceeded.values()), commands.exceeded


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


@pytest.mark.parametrize("shape", [(1,), (3,), (1, 2), (), (0,)])
def test_an_action_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    loop = PolicyLoop(views(), lambda _: np.zeros(shape), GOAL, 1.0)
    with loop, Sim("finger") as sim, pytest.raises(ContidError, match="these robots take"):
        loop(ServoState(0, 0.0, telemetry(sim), 0, ""))


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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("socket finger", "usage: python -m contid_learn.drive SOCKET ROBOT_FILE FILE GOAL [SECONDS]"),
        ("socket nosuch p.onnx x_mm=1,y_mm=2", "nosuch: no such file"),
        ("socket finger p.onnx x_mm=30,y_mm=85 soon", "SECONDS: 'soon'; allowed: a number above 0"),
    ],
)
def test_wrong_arguments_are_named(
    arguments: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """Also where the run has ended meanwhile, which excused every error; too few were a `ValueError`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("contid_learn.drive._watch_stdin", lambda: None)
    monkeypatch.setattr("contid_learn.drive._ended.is_set", lambda: True)
    written(tmp_path / "p.onnx")
    assert main(arguments.split()) == 2
    assert message in capsys.readouterr().err
