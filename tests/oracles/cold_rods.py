"""Cold starts of two pneumatic sections: ``python -m tests.oracles.cold_rods --cases 10000``; prints counts.

Pressures are drawn in the box, their poses are the targets, and every search begins at 0.5 bar.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from contid.kinematics.model import build_model
from contid.robot_file.load import load_named
from contid.targets import Target
from contid.units import BAR, MM_PER_M
from tests.oracles.rods import FIXED_BAR

#: Distance between a target and `forward` of its answer that contradicts the answer [mm].
CONTRADICTED_MM = 0.05


def count(mode: str, load_n: float, cases: int, seed: int = 21) -> bool:
    """Print one line; False where `forward` of an answer is elsewhere."""
    (robot,) = load_named("stiffflop2").file.robots.values()
    model = build_model(robot)
    low, high = np.array(model.lower), np.array(model.upper)
    rng = np.random.default_rng(seed)
    load, start = (0.0, 0.0, load_n), (0.5 * BAR,) * len(low)
    missed, off, moved = 0, [0.0], [0.0]
    for _ in range(cases):
        pose = model.forward(tuple((low + rng.uniform(size=len(low)) * (high - low)).tolist()), load)
        direction = pose.direction if mode == "tip + direction" else None
        target = Target(pose.tip_m, direction, pose.mid_m if mode == "mid + tip" else None, load_n=load)
        first = model.inverse(target, start)
        if not first.converged:
            missed += 1
            continue
        reached = model.forward(first.actuation, load).tip_m
        off.append(MM_PER_M * float(np.linalg.norm(np.subtract(reached, pose.tip_m))))
        again = model.inverse(target, first.actuation)
        moved.append(float(np.abs(np.subtract(again.actuation, first.actuation)).max()) / BAR)
    wrong = sum(distance > CONTRADICTED_MM for distance in off)
    far = sum(change > FIXED_BAR for change in moved)
    print(
        f"{mode:15} {load_n:.5f} N: {missed} of {cases} not converged, {wrong} contradicted by forward "
        f"(worst {max(off):.2g} mm), {far} moved when asked again (worst {max(moved):.2g} bar)",
        flush=True,
    )
    return wrong == 0


def main() -> int:
    """Count for three kinds of target and three loads; exit 1 when an answer is contradicted."""
    parser = argparse.ArgumentParser(prog="python -m tests.oracles.cold_rods")
    parser.add_argument("--cases", type=int, default=1000)
    cases = parser.parse_args().cases
    modes, loads = ("tip", "mid + tip", "tip + direction"), (0.0, 0.04905, 0.0981)
    held = [count(mode, load_n, cases) for mode in modes for load_n in loads]
    return 0 if all(held) else 1


if __name__ == "__main__":
    sys.exit(main())
