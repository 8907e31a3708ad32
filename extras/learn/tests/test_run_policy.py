"""`contid run --policy` as a user starts it: the tip goes to its goal; mistakes are refused before motion."""

from __future__ import annotations

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from contid import Robot
from contid_learn import PolicyAbout, write_policy
from contid_learn.views import views_of
from tests.support.command import environment

RUN = ("run", "finger", "--mock")


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
        timeout=90,
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
    goal = ("--policy", "p.onnx", "--goal", "x_mm=30,y_mm=85", "--policy-for", "12", "--log", "log.csv")
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
