"""Warm solves of two pneumatic sections: ``python -m tests.oracles.warm_rods``; prints counts.

Each path is straight in pressures, its poses are the targets, and every search begins at the answer before:
loads of up to 10 g down or in any direction, tip, mid-point + tip, and tip + direction.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from contid.kinematics.cosserat.model import CosseratModel
from contid.kinematics.model import build_model
from contid.robot_file.load import load_named
from contid.targets import Vec3
from tests.oracles.cold_rods import CONTRADICTED_MM

#: Points of a path, and how far it leads from one random point of the box to another.
POINTS, SHARE = 200, 0.3
LOADS_N = (0.0, 0.0196, 0.049, 0.0981)
MOST_BAR = 1.5


def random_force(rng: np.random.Generator) -> Vec3:
    """Down, or in any direction [N]."""
    load = float(rng.choice(LOADS_N))
    x, y, z = rng.standard_normal(3) * 0.4 * load
    return (0.0, 0.0, load) if rng.random() < 0.6 else (float(x), float(y), float(z))


def count(solves: int, seed: int) -> bool:
    """Print each answer that `forward` contradicts, and counts; False where there is one."""
    (robot,) = load_named("stiffflop2").file.robots.values()
    model = build_model(robot)
    assert isinstance(model, CosseratModel)
    engine, rng = model.engine, np.random.default_rng(seed)
    done, wrong, unmet, worst = 0, 0, 0, 0.0
    while done < solves:
        force, mode = random_force(rng), int(rng.integers(3))
        begin, end = rng.uniform(0.0, MOST_BAR, (2, 6))
        seed_bar = tuple(begin.tolist())
        for part in np.linspace(0.0, SHARE, POINTS):
            at = engine.forward((begin + part * (end - begin)).tolist(), force)
            if not at.stable:
                break
            direction = (at.rotation[2], at.rotation[5], at.rotation[8]) if mode == 2 else None
            target = at.tip_mm, at.mid_mm if mode == 1 else None, direction
            answer = engine.inverse(*target, force, seed_bar)
            done += 1
            if not (answer.met and answer.stable):
                unmet += 1
                break
            reached = engine.forward(answer.pressures_bar, force)
            off = float(np.linalg.norm(np.subtract(reached.tip_mm, at.tip_mm)))
            worst = max(worst, off)
            if off > CONTRADICTED_MM or not reached.stable:
                wrong += 1
                state = "" if reached.stable else ", unstable"
                print(f"{off:.3g} mm from forward{state}: {target}, {force}, {seed_bar}")
            seed_bar = answer.pressures_bar
    print(
        f"{done} warm solves: {wrong} contradicted by forward (worst {worst:.2g} mm), {unmet} not converged"
    )
    return wrong == 0


def main() -> int:
    """Count; exit 1 when an answer is contradicted."""
    parser = argparse.ArgumentParser(prog="python -m tests.oracles.warm_rods")
    parser.add_argument("--solves", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=7)
    given = parser.parse_args()
    return 0 if count(given.solves, given.seed) else 1


if __name__ == "__main__":
    sys.exit(main())
