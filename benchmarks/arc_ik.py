"""Measurements of the arms of sections: cold starts, closed paths, kernel and call times, ratios in one run.

Run from the root of the repository: ``python benchmarks/arc_ik.py [TARGETS]``; 20 000 targets per robot and
mode by default. Times are medians; compare ratios, not machines.
"""

from __future__ import annotations

import dataclasses
import math
import statistics
import sys
import time
from pathlib import Path

import numpy as np

from contid.kinematics.arc.section_model import SectionModel, build_solver
from contid.kinematics.arc.solver import tuning_for
from contid.kinematics.model import build_model
from contid.robot_file.load import load_robot_file
from contid.targets import Target
from studies import singh
from studies.arc_chains import forward

CONFIGS = Path(__file__).parent.parent / "configs"


def model_of(name: str) -> SectionModel:
    (robot,) = load_robot_file(CONFIGS / f"{name}.yaml").file.robots.values()
    model = build_model(robot)
    assert isinstance(model, SectionModel)
    return model


def cold_starts(name: str, count: int) -> None:
    """Random reachable targets, random seeds, dense up to the limits."""
    model = model_of(name)
    feasible = model.feasible
    rng = np.random.default_rng(20_000)
    spread = feasible.high - feasible.low
    for mode in ("tip", "tip+direction", "mid+tip"):
        if feasible.sections.count == 1 and mode != "tip":
            continue
        met, worst, outside, steps, starts, spent = 0, 0.0, -math.inf, [], 0, []
        for _ in range(count):
            lengths, seed = (feasible.pulled(feasible.low + rng.random(len(spread)) * spread) for _ in "ab")
            at = forward(feasible.sections, lengths)
            direction = tuple(at.rotation[:, 2].tolist()) if "direction" in mode else None
            mid = tuple(at.mid.tolist()) if "mid" in mode else None
            begin = time.perf_counter_ns()
            found, residual, _, _, iterations, tried = model.solver.solve(
                tuple(at.tip.tolist()), direction, mid, tuple(seed.tolist())
            )
            spent.append(time.perf_counter_ns() - begin)
            excess = float(np.max(feasible.excess(np.array(found))))
            met += residual <= 1e-6 and excess <= 1e-12
            worst, outside = max(worst, residual), max(outside, excess)
            steps.append(iterations)
            starts = max(starts, tried)
        print(
            f"{name:9} {mode:14} {met}/{count} within limits and 1e-3 mm; worst {worst * 1e3:.1e} mm, "
            f"iterations mean {statistics.mean(steps):.1f} median {statistics.median(steps):.0f} "
            f"max {max(steps)}, starts max {starts}, median {statistics.median(spent) / 1e3:.1f} us"
        )


def closed_path() -> None:
    """The golden trajectory there and back 50 times."""
    model = model_of("cbha")
    golden = singh.golden_trajectory()
    seed = tuple(golden.lengths_m[0].tolist())
    laps = []
    for _ in range(51):
        lap = []
        for tip in (*golden.tips_m, *golden.tips_m[::-1]):
            seed = model.inverse(Target(tip_m=tuple(tip.tolist())), seed).actuation
            lap.append(seed)
        laps.append(np.array(lap))
    drift = 1e3 * np.abs(laps[-1] - laps[0])
    print(f"drift of lengths over 50 more laps: {1e3 * np.abs(laps[-1] - laps[1]).max():.1e} mm from lap 2,")
    print(f"  {drift[99:].max():.1e} mm from the turning point of lap 1 (lap 1 starts from other lengths)")
    print(f"  there against back: {1e3 * np.abs(laps[-1][:100] - laps[-1][:99:-1]).max():.1e} mm")


def two_segment_path() -> np.ndarray:
    turn = np.linspace(0.0, 2.0 * np.pi, 100)
    return np.stack((0.15 * np.cos(turn), 0.15 * np.sin(turn), 0.45 + 0.05 * np.sin(2.0 * turn)), axis=-1)


def times() -> None:
    """Kernel alone (a whole path in one call), whole calls from Python, the paper's methods in NumPy."""
    golden = singh.golden_trajectory()
    newton = []
    lengths = golden.lengths_m[0]
    for target in golden.tips_m[1:]:
        begin = time.perf_counter_ns()
        lengths, _ = singh.newton_raphson(singh.cbha_sections(), target, lengths)
        newton.append(time.perf_counter_ns() - begin)
    paper = statistics.median(newton) / 1e3
    print(f"Newton-Raphson of the paper in NumPy: {paper:.0f} us per point (paper, MATLAB: 233500)")
    for name, tips in (("cbha", golden.tips_m), ("trirack2", two_segment_path())):
        model = model_of(name)
        seed = tuple(model.feasible.home.tolist())
        if hasattr(model.solver, "follow"):
            home = dataclasses.replace(tuning_for(model.feasible), home_steps=0)
            for what, solver in (
                ("", model.solver),
                (", without homing", build_solver(model.feasible, home)),
            ):
                out = np.empty((len(tips), len(seed)))
                solver.follow(tips, seed, out)
                start, spent = tuple(out[0].tolist()), []
                for _ in range(200):
                    begin = time.perf_counter_ns()
                    solver.follow(tips, start, out)
                    spent.append((time.perf_counter_ns() - begin) / len(tips))
                kernel = statistics.median(spent) / 1e3
                ratio = f"Newton-Raphson in NumPy takes {paper / kernel:.0f} times as long"
                print(f"{name}: kernel {kernel:.2f} us per warm point{what}; {ratio}")
        calls = []
        for _ in range(20 if hasattr(model.solver, "follow") else 1):
            for tip in tips:
                target = Target(tip_m=tuple(tip.tolist()))
                begin = time.perf_counter_ns()
                seed = model.inverse(target, seed).actuation
                calls.append(time.perf_counter_ns() - begin)
        print(
            f"{name}: whole call from Python {statistics.median(calls) / 1e3:.2f} us median, "
            f"{np.percentile(calls, 99) / 1e3:.2f} us at 99 %"
        )


def out_of_reach(count: int) -> None:
    """What an unreachable target costs: every start is tried until three agree."""
    rng = np.random.default_rng(3)
    for name in ("cbha", "trirack", "trirack2"):
        model = model_of(name)
        home, spent = tuple(model.feasible.home.tolist()), []
        for _ in range(count):
            away = rng.normal(size=3)
            tip = away / np.linalg.norm(away) * rng.uniform(1.0, 2.0) * sum(model.feasible.upper)
            begin = time.perf_counter_ns()
            solution = model.inverse(Target(tip_m=tuple(tip.tolist())), home)
            spent.append(time.perf_counter_ns() - begin)
            assert not solution.converged
            assert solution.limited_by
        print(
            f"{name}: out of reach {statistics.median(spent) / 1e3:.0f} us median, "
            f"{np.percentile(spent, 99) / 1e3:.0f} us at 99 %"
        )


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
    times()
    closed_path()
    out_of_reach(min(count, 300))
    for name in ("cbha", "trirack", "trirack2"):
        cold_starts(name, count)


if __name__ == "__main__":
    main()
