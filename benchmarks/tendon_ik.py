"""Inverse kinematics of tendon robots: ``python benchmarks/tendon_ik.py [POSES]``.

Random reachable poses of three sections (tip and direction, then tip and whole frame; any bends inside every
limit), each solved from the straight robot, with the tensions of every answer; beside it trirack2 in the same
run, poses drawn alike, because only ratios hold on other machines. Each pose is timed three times, the
shortest counts: the machine is shared.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import Final

import numpy as np

from contid.kinematics.arc.section_model import SectionModel
from contid.kinematics.model import build_model
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.load import load_named
from contid.targets import Actuation, Pose, Solution, Target

TIMES: Final = 3


def solved(
    model: TendonModel | SectionModel, poses: Sequence[Pose], seed: Actuation, frames: bool = False
) -> tuple[list[Solution], np.ndarray]:
    """Answers for tips with directions or whole frames, and the time of each [us]."""
    answers, times_us = [], np.empty(len(poses))
    for k, pose in enumerate(poses):
        target = Target(tip_m=pose.tip_m, direction=pose.direction)
        if frames:
            target = Target(tip_m=pose.tip_m, rotation=pose.rotation)
        best = float("inf")
        for _ in range(TIMES):
            start = time.perf_counter()
            answer = model.inverse(target, seed)
            best = min(best, time.perf_counter() - start)
        answers.append(answer)
        times_us[k] = 1e6 * best
    return answers, times_us


def tendon_robot(name: str, count: int) -> np.ndarray:
    """Figures of one tendon robot; returns the times."""
    (robot,) = load_named(name).file.robots.values()
    model = build_model(robot)
    assert isinstance(model, TendonModel)
    assert model.statics is not None
    rng, feasible = np.random.default_rng(20), model.feasible
    lengths = np.repeat(feasible.sections.backbone_m, 2)
    bends = [feasible.pulled(rng.uniform(feasible.low, feasible.high)) / lengths for _ in range(count)]
    poses = [model.forward(tuple(model.statics.pulls(each).tolist())) for each in bends]
    answers, times_us = solved(model, poses, robot.rest)
    framed, framed_us = solved(model, poses, robot.rest, frames=True)
    slack = over = 0
    for answer in (*answers, *framed):
        tensions = model.statics.tensions(np.array(answer.actuation))
        slack += bool(np.min(tensions) < model.statics.floor_n - 1e-6)
        over += bool(np.max(tensions) > model.statics.limit_n + 1e-6)
    report(name, answers, times_us)
    report(f"{name}, whole frame", framed, framed_us)
    print(f"  slack commands: {slack}; commands over the largest tension: {over}")
    return times_us


def tri_rack(count: int) -> np.ndarray:
    """Figures of trirack2 in the same run; returns the times."""
    (robot,) = load_named("trirack2").file.robots.values()
    model = build_model(robot)
    assert isinstance(model, SectionModel)
    rng, feasible = np.random.default_rng(20), model.feasible
    postures = [feasible.pulled(rng.uniform(feasible.low, feasible.high)) for _ in range(count)]
    poses = [model.forward(tuple(posture.tolist())) for posture in postures]
    answers, times_us = solved(model, poses, tuple(feasible.home.tolist()))
    report("trirack2", answers, times_us)
    return times_us


def report(name: str, answers: Sequence[Solution], times_us: np.ndarray) -> None:
    """One line: share met at 1e-6 m, and times."""
    met = sum(answer.converged and answer.residual_m <= 1e-6 for answer in answers)
    median, p99, most = np.percentile(times_us, [50, 99, 100])
    print(
        f"{name}: {100.0 * met / len(answers):.2f} % of {len(answers)} met at 1e-6 m; "
        f"median {median:.0f} us, p99 {p99:.0f} us, maximum {most:.0f} us"
    )


def main() -> None:
    """See the module."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    beside = tri_rack(count)
    for name in ("tendon3", "ftdcr_v4"):
        times_us = tendon_robot(name, count)
        ratio = np.percentile(times_us, [50, 99]) / np.percentile(beside, [50, 99])
        print(f"  beside trirack2: {ratio[0]:.2f} times its median, {ratio[1]:.2f} times its p99")


if __name__ == "__main__":
    main()
