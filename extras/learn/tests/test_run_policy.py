"""`contid run --policy` as a user starts it: the tip goes to its goal; mistakes are refused before motion."""

from __future__ import annotations

import csv
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from contid import Robot
from contid_learn import PolicyAbout, write_policy
from contid_learn.views import views_of
from tests.support.command import environment

RUN = ("run", "finger", "--mock")
#: How long garbage moves a robot in real time [s].
GARBAGE_S = float(os.environ.get("CONTID_GARBAGE_S", "3"))


def contid_in(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Without an input, as at a terminal."""
    command = [sys.executable, "-m", "contid", *arguments]
    return subprocess.run(
        command,
        cwd=folder,
        env={**environment(), "XDG_RUNTIME_DIR": str(folder)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=90 + 3 * GARBAGE_S,
        check=False,
    )


def written(path: Path, gain: float = 2.0) -> None:
    """A policy that goes where the goal is; with a gain that is not finite one that answers NaN.

    With thrice the gain the delay of the stream makes the tip circle about its goal.
    """
    weights = np.zeros((2, 10))
    weights[:, 6:8] = gain * np.array([[-1.0, 1.0], [1.0, 1.0]])
    write_policy(
        path, PolicyAbout.of(views_of(Robot("finger"), 20.0), 20.0, "reach"), [(weights, np.zeros(2))]
    )


def commands(path: Path) -> list[list[float]]:
    with path.open() as file:
        rows = [[row[f"finger.{axis}.command"] for axis in ("left", "right")] for row in csv.DictReader(file)]
    return [[1e3 * float(value) for value in row] for row in rows if all(row) and row[0] != "nan"]


@pytest.mark.process
@pytest.mark.realtime
def test_a_policy_brings_the_tip_to_its_goal_and_ends_the_run(tmp_path: Path) -> None:
    written(tmp_path / "p.onnx")
    goal = ("--policy", "p.onnx", "--goal", "x_mm=30,y_mm=85", "--policy-for", "6", "--log", "log.csv")
    done = contid_in(tmp_path, *RUN, *goal)
    assert done.returncode == 130, done.stderr  # as by `contid stop --end`
    assert "actions; held: " in done.stderr
    moved = commands(tmp_path / "log.csv")
    tip = Robot("finger").fk(moved[-1]).tip
    assert np.linalg.norm(tip - [30.0, 85.0]) < 1.0
    speed = np.abs(np.diff(moved, axis=0)) * 200.0
    assert speed.max() <= 60.0 * (1.0 + 1e-6)


@pytest.mark.process
@pytest.mark.realtime
def test_a_policy_that_answers_no_number_moves_nothing(tmp_path: Path) -> None:
    written(tmp_path / "p.onnx", gain=np.nan)
    goal = ("--policy", "p.onnx", "--goal", "x_mm=30,y_mm=85", "--policy-for", "1.5", "--log", "log.csv")
    done = contid_in(tmp_path, *RUN, *goal)
    assert "0 actions; held: " in done.stderr
    assert np.ptp(commands(tmp_path / "log.csv"), axis=0).max() < 0.2


def with_outputs_of(path: Path, nodes: list[onnx.NodeProto], kind: int = TensorProto.FLOAT) -> None:
    """Give the network of a policy other nodes, which end in ``action``."""
    model = onnx.load(path)
    constants = [
        numpy_helper.from_array(np.array(value, np.float32), name)
        for name, value in (("third", 0.33), ("half", 0.5), ("huge", 3e37), ("three", 3.0))
    ]
    seen = model.graph.input[0]
    done = helper.make_tensor_value_info("action", kind, None)
    graph = helper.make_graph(nodes, "policy", [seen], [done], constants)
    broken = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    broken.metadata_props.extend(model.metadata_props)
    onnx.save(broken, path)


def random_nodes() -> list[onnx.NodeProto]:
    """A third each: logarithms, half of them of negative numbers; up to infinity; beyond -1 to 1."""
    node = helper.make_node
    return [
        node("RandomNormal", [], ["r"], shape=[1, 2]), node("RandomUniform", [], ["u"], shape=[1, 2]),
        node("RandomUniform", [], ["v"], shape=[1, 2]), node("Log", ["r"], ["logarithms"]),
        node("Mul", ["r", "huge"], ["large"]), node("Mul", ["large", "three"], ["larger"]),
        node("Mul", ["r", "three"], ["noise"]), node("Less", ["u", "third"], ["is_log"]),
        node("Less", ["v", "half"], ["is_huge"]), node("Where", ["is_huge", "larger", "noise"], ["rest"]),
        node("Where", ["is_log", "logarithms", "rest"], ["action"]),
    ]  # fmt: skip


@pytest.mark.process
@pytest.mark.realtime
def test_a_policy_of_garbage_exceeds_no_limit_in_real_time(tmp_path: Path) -> None:
    written(tmp_path / "p.onnx")
    with_outputs_of(tmp_path / "p.onnx", random_nodes())
    goal = ("--policy", "p.onnx", "--goal", "x_mm=30,y_mm=85", "--policy-for", str(GARBAGE_S))
    done = contid_in(tmp_path, *RUN, *goal, "--log", "log.csv")
    assert done.returncode == 130, done.stderr
    counts = [int(count) for count in re.findall(r"(\d+) (?:actions|stale|not finite|refused)", done.stderr)]
    ticks, moved = judged(tmp_path / "log.csv")
    print(f"{counts} actions, stale, not finite, refused; {ticks} ticks; {moved}; {done.stderr}")
    assert counts[0] > 2 * GARBAGE_S
    assert counts[2] > 2 * GARBAGE_S
    assert {**moved, "jerk": 0} == {"position": 0, "velocity": 0, "acceleration": 0, "jerk": 0}, moved


def judged(path: Path) -> tuple[int, dict[str, int]]:
    """The ticks of a log, and how many of them exceed the limits of the shipped finger."""
    with path.open() as file:
        found = [
            (
                int(row["tick"]),
                *(1e3 * float(row[f"finger.{axis}.command"] or "nan") for axis in ("left", "right")),
            )
            for row in csv.DictReader(file)
        ]
    rows = np.array([row for row in found if np.isfinite(row).all()])
    ticks, at = rows[:, 0], rows[:, 1:]
    exceeded = {"position": int(((at < -1e-9) | (at > 100.0 + 1e-9)).sum())}
    for order, (name, most) in enumerate((("velocity", 60.0), ("acceleration", 1e3), ("jerk", 2e4)), 1):
        follow = np.diff(ticks, order, axis=0) == (1 if order == 1 else 0)
        follow &= ticks[order:] - ticks[:-order] == order
        rate = np.abs(np.diff(at, order, axis=0)) * 200.0**order
        exceeded[name] = int((rate[follow] > most * (1 + 1e-6) + 1e-12 * 200.0**order).sum())
    return len(rows), exceeded


@pytest.mark.process
@pytest.mark.parametrize(
    ("nodes", "kind", "message"),
    [
        ([helper.make_node("Constant", [], ["action"], value_strings=["left", "right"])], TensorProto.STRING,
         "its output 'action' is no tensor of numbers"),
        ([helper.make_node("RandomNormal", [], ["action"], shape=[3])], TensorProto.FLOAT,
         "it answers 3 numbers for 2 axes"),
        ([helper.make_node("RandomNormal", [], ["action"], shape=[0])], TensorProto.FLOAT,
         "it answers 0 numbers for 2 axes"),
    ],
)  # fmt: skip
def test_a_network_that_gives_no_actions_is_refused_before_anything_moves(
    tmp_path: Path, nodes: list[onnx.NodeProto], kind: int, message: str
) -> None:
    written(tmp_path / "p.onnx")
    with_outputs_of(tmp_path / "p.onnx", nodes, kind)
    done = contid_in(tmp_path, *RUN, "--policy", "p.onnx", "--goal", "x_mm=1,y_mm=2")
    assert (done.returncode, "Traceback" in done.stderr) == (2, False), done.stderr
    assert message in " ".join(done.stderr.split())


@pytest.mark.process
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--policy", "p.onnx"), "--policy needs --goal"),
        (("--goal", "x_mm=1"), "--goal is for --policy, which is not given"),
        (("--policy", "p.onnx", "--goal", "x_mm=1,y_mm=2", "--virtual"), "needs a daemon in real time"),
        (("--policy", "p.onnx", "--goal", "x_mm=1,y_mm=2", "--trajectory", "p.onnx"), "leave one out"),
        (("--policy", "none.onnx", "--goal", "x_mm=1"), "'none.onnx' does not exist"),
        (("--policy", "p.onnx", "--goal", "x_mm=1"), "no y_mm; needed: x_mm, y_mm"),
    ],
)
def test_mistakes_are_refused_before_anything_moves(
    tmp_path: Path, options: tuple[str, ...], message: str
) -> None:
    written(tmp_path / "p.onnx")
    done = contid_in(tmp_path, *RUN, *options)
    assert done.returncode == 2
    assert message in " ".join(done.stderr.split())
