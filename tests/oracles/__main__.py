"""Long form of the oracles: ``python -m tests.oracles --cases 10000``; prints counts and worst values."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from contid.kinematics.arc.section_model import SectionModel
from contid.kinematics.model import build_model
from contid.robot_file.load import load_named
from tests.oracles.arcs import random_posture, tip_and_tangent
from tests.oracles.bounded import LOADS_G, count
from tests.oracles.elastic_rods import compare_all
from tests.oracles.rods import FIXED_BAR, NEAR_REST, moves


def settled(name: str, most_rad: float, directed: bool, cases: int) -> bool:
    """Ask for random reachable targets twice, from home and then from the answer."""
    (robot,) = load_named(name).file.robots.values()
    model = build_model(robot)
    assert isinstance(model, SectionModel)
    feasible, solver = model.feasible, model.solver
    rng = np.random.default_rng(16)
    home = tuple(feasible.home.tolist())
    missed, moved, errors, spent = 0, [], [], []
    for _ in range(cases):
        tip, tangent = tip_and_tangent(feasible, random_posture(feasible, rng, most_rad))
        goal = tuple(tip.tolist()), tuple(tangent.tolist()) if directed else None, None
        begin = time.perf_counter_ns()
        first = solver.solve(*goal, home)
        spent.append((time.perf_counter_ns() - begin) / 1e3)
        missed += not first[2]
        again = solver.solve(*goal, first[0])
        moved.append(float(np.abs(np.subtract(again[0], first[0])).max()))
        errors.append(float(np.linalg.norm(tip_and_tangent(feasible, np.array(first[0]))[0] - tip)))
    far = sum(change > 1e-8 for change in moved)
    print(
        f"settled {name:9} {'tip + direction' if directed else 'tip':15} bends to {most_rad:.2f} rad: "
        f"{missed} of {cases} missed, {far} moved by more than 1e-5 mm when asked again "
        f"(worst {max(moved) * 1e3:.2g} mm), tip error worst {max(errors) * 1e3:.2g} mm, "
        f"{np.median(spent):.1f} us median, {np.percentile(spent, 99):.1f} us at 99 %"
    )
    return missed == 0 and far == 0


def settled_rods(share: float, directed: bool, load_n: float, cases: int) -> bool:
    """The same for two pneumatic sections, with pressures up to a share of their range."""
    missed, moved = moves(share, directed, load_n, cases)
    far = sum(change > FIXED_BAR for change in moved)
    print(
        f"settled stiffflop2 {'tip + direction' if directed else 'tip':15} pressures to {share:.0%}, "
        f"load {load_n:g} N: {missed} of {cases} missed, {far} moved by more than {FIXED_BAR:g} bar when "
        f"asked again (worst {max(moved):.2g} bar)"
    )
    # Under load a target drawn elsewhere may be one that the start does not lead to.
    return far == 0 and (missed == 0 or load_n > 0.0)


def main() -> int:
    """Run every oracle; exit 1 when one of those that must hold does not."""
    parser = argparse.ArgumentParser(prog="python -m tests.oracles")
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--statics", type=Path, metavar="DIR", help="only rods: tables of SoRoSim in DIR")
    given = parser.parse_args()
    if given.statics is not None:
        return 0 if compare_all(given.statics) else 1
    cases = given.cases
    held = True
    for name in ("trirack2", "cbha"):
        for directed in (False, True):
            held &= settled(name, np.pi / 3, directed, cases)
            settled(name, 1.2 * np.pi, directed, cases)
    for share in (NEAR_REST, 1.0):
        for directed in (False, True):
            held &= settled_rods(share, directed, 0.0, cases)
            held &= settled_rods(share, directed, 0.05, cases)
    for grams in LOADS_G:  # scipy takes about a second a case
        held &= count(grams, max(4, cases // 50), starts=10)
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
