"""Redundant arms among obstacles: targets met with a clear body, beside a multi-start search in the same run.

Run from the root of the repository: ``python -m benchmarks.obstacles [--cases N] [--seed S]``. A case is the
tip of a random posture and 3 to 10 random spheres, capsules and boxes; the seed is the home posture. The
search draws random postures of the target: random seeds, without preference for the home posture, until one
is clear or the draws are spent. A body is clear when the lower bound of `contid_clearance` keeps the margin.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.section_model import build_solver
from contid.kinematics.arc.sections import Sections, backbone
from contid.kinematics.arc.solver import FORCE, ZONE, tuning_for
from contid.kinematics.array import Array
from contid_clearance.body import sampled_body
from contid_clearance.distances import to_obstacle
from contid_clearance.obstacles import Box, Capsule, Obstacle

RADIUS_M, MARGIN_M, FROM_M = 0.04, 0.005, 0.06
#: Random postures of the search.
DRAWS = 200


def arms() -> dict[str, Feasible]:
    racks = (-np.pi, -np.pi / 3, -5 * np.pi / 3)
    two = Sections((0.035,) * 2, (racks,) * 2, (0.030, 0.0))
    three = Sections((0.035,) * 3, (racks,) * 3, (0.030, 0.030, 0.0))
    return {
        "trirack2": Feasible(two, (0.010,) * 2, (0.650,) * 2, rack_m=0.790, curvature_max=1 / 0.12),
        "three sections": Feasible(three, (0.010,) * 3, (0.450,) * 3, rack_m=0.900, curvature_max=1 / 0.12),
    }


def random_posture(feasible: Feasible, rng: np.random.Generator) -> Array:
    """Inside every limit."""
    return feasible.pulled(feasible.low + rng.random(len(feasible.low)) * (feasible.high - feasible.low))


def obstacles(feasible: Feasible, rng: np.random.Generator, tip: Array) -> list[Obstacle]:
    """Three to ten about points of random postures, clear of the mount and of the tip."""
    found: list[Obstacle] = []
    mount = np.stack([np.zeros(9), np.zeros(9), np.linspace(0.0, 0.1, 9)], axis=1)
    free = np.vstack([mount, tip])
    count = int(rng.integers(3, 11))
    while len(found) < count:
        share = rng.uniform(0.2, 1.0)
        at = backbone(feasible.sections, random_posture(feasible, rng), 33)[int(32 * share)] + rng.normal(
            0.0, 0.03, 3
        )
        kind = rng.integers(3)
        if kind == 0:
            each: Obstacle = Capsule(at, at, rng.uniform(0.02, 0.08))
        elif kind == 1:
            each = Capsule(at, at + rng.uniform(-0.2, 0.2, 3), rng.uniform(0.01, 0.04))
        else:
            turned = Rotation.random(random_state=rng).as_matrix()
            each = Box(at, turned, rng.uniform(0.015, 0.08, 3))
        if each.signed_distance(free).min() > RADIUS_M + MARGIN_M + 0.005:
            found.append(each)
    return found


def is_clear(feasible: Feasible, lengths: Array, around: list[Obstacle]) -> bool:
    """True when the body certainly keeps the margin."""
    coarse = backbone(feasible.sections, lengths, 65)
    step = float(np.linalg.norm(np.diff(coarse, axis=0), axis=1).sum()) / 64
    from_point = int(np.ceil(FROM_M / step))
    for each in around:  # most postures that are not clear are so at samples
        if each.signed_distance(coarse[from_point:]).min() < RADIUS_M + MARGIN_M:
            return False
    whole = sampled_body(lambda count: backbone(feasible.sections, lengths, count), RADIUS_M)
    body = whole.part(FROM_M, whole.pieces * whole.spacing_m)
    return all(to_obstacle(body, each, MARGIN_M).lower_m >= MARGIN_M for each in around)


@dataclass
class Counts:
    """What became of the cases of one arm."""

    cases: int = 0
    plain: int = 0
    by_search: int = 0
    solved: int = 0
    both: int = 0
    claimed: int = 0
    spent_us: list[float] = field(default_factory=list)
    plain_us: list[float] = field(default_factory=list)

    def __str__(self) -> str:
        share = 100.0 * self.both / max(self.by_search, 1)
        return (
            f"{self.cases} cases; clear without avoiding {self.plain}; search solves {self.by_search}; "
            f"contid solves {self.solved}, {share:.2f} % of those of the search; "
            f"median {np.median(self.spent_us):.0f} us, p99 {np.percentile(self.spent_us, 99):.0f} us "
            f"(without obstacles {np.median(self.plain_us):.0f} us)"
        )


def run(feasible: Feasible, cases: int, seed: int) -> Counts:
    """Counts of one arm."""
    rng, counts = np.random.default_rng(seed), Counts()
    tuning = tuning_for(feasible)
    plain, around = build_solver(feasible), build_solver(feasible)
    drawn = build_solver(feasible, dataclasses.replace(tuning, home_steps=0))
    home = tuple(feasible.home.tolist())

    for _ in range(cases):
        tip = np.array(plain.forward(tuple(random_posture(feasible, rng).tolist()))[0])
        while float(tip[2]) < 0.12:
            tip = np.array(plain.forward(tuple(random_posture(feasible, rng).tolist()))[0])
        target = tuple(tip.tolist())
        placed = obstacles(feasible, rng, tip)
        rows = [each.packed.tolist() for each in placed]
        around.avoid(rows, RADIUS_M, MARGIN_M, FROM_M, ZONE * tuning.ell_m, FORCE * tuning.ell_m)
        begin = time.thread_time_ns()
        first = plain.solve(target, None, None, home)
        middle = time.thread_time_ns()
        found = around.solve(target, None, None, home)
        counts.spent_us.append((time.thread_time_ns() - middle) / 1e3)
        counts.plain_us.append((middle - begin) / 1e3)
        solved = found[2] and is_clear(feasible, np.array(found[0]), placed)
        searched = False
        for _ in range(DRAWS):
            answer = drawn.solve(target, None, None, tuple(random_posture(feasible, rng).tolist()))
            if answer[2] and is_clear(feasible, np.array(answer[0]), placed):
                searched = True
                break
        counts.cases += 1
        counts.plain += first[2] and is_clear(feasible, np.array(first[0]), placed)
        counts.solved += solved
        counts.by_search += searched
        counts.both += solved and searched
    return counts


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=1000, help="per arm")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    for name, feasible in arms().items():
        print(f"{name}: {run(feasible, chosen.cases, chosen.seed)}", flush=True)


if __name__ == "__main__":
    main()
