"""Targets of loaded pneumatic arms beside clouds of poses that `rod_walk` gets to.

``python -m tests.oracles.clouds --cases 10000``. Every pose is one that the arm reaches when its pressures
and loads are raised together, so an answer that stays farther from its target than the nearest pose of the
cloud is not the nearest. A cloud is coarse: it is no proof that answers are the nearest, but it needs no
solver. Half the targets are drawn in a box around the arm, half are tips of another cloud, which must be met.
Where an answer is on its target, a walk from the pressures where the search began must end there.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from contid.kinematics.array import Array
from contid.kinematics.cosserat.branch import load_scale
from contid.kinematics.cosserat.model import CosseratModel
from contid.targets import Solution, Vec3
from contid.units import BAR, MM_PER_M
from tests.oracles.bounded import BOX, GRAM_N, LOADS_G, QUANTILES, WALKED_MM, Case, answer, models
from tests.oracles.rod_walk import walk

#: Poses of a cloud, and how many are walked together.
POSES, CHUNK = 20000, 2000
#: Difference of the two discretisations [mm]; an answer that is farther by less is as near.
AS_NEAR_MM = 0.05


@dataclass(frozen=True)
class Beside:
    """An answer, and how far the nearest pose of the cloud is from its target [mm].

    A target is reachable in the sense of `Case` where it is the tip of a walked pose.
    """

    case: Case
    solution: Solution
    cloud_mm: float

    @property
    def left_mm(self) -> float:
        """The error that the answer reports."""
        return MM_PER_M * self.solution.residual_m

    @property
    def farther_mm(self) -> float:
        """How much nearer the cloud is."""
        return self.left_mm - self.cloud_mm


def tips(model: CosseratModel, load_n: Vec3, number: int, rng: np.random.Generator) -> Array:
    """Tips [mm], at most ``number`` rows, of random pressures that the walk gets to; most are at limits."""
    low, high = model.setup.limits.lower, model.setup.limits.upper
    share = np.clip(rng.uniform(-1.0, 2.0, (number, len(low))), 0.0, 1.0)
    bars = low + share * (high - low)
    rod, loads = model.setup.rod, model.setup.loads(load_n)
    found = []
    for begin in range(0, number, CHUNK):
        walked = walk(rod, loads, load_scale(rod, loads), bars[begin : begin + CHUNK])
        found.append(walked.tip[walked.there])
    return np.concatenate(found)


def compare(
    model: CosseratModel, load_n: Vec3, number: int, cloud: Array, rng: np.random.Generator
) -> list[Beside]:
    """Answers from random pressures to targets in a box, and from rest to as many tips of another cloud."""
    low, high = model.setup.limits.lower, model.setup.limits.upper
    goals = model.setup.rod.reach * rng.uniform(*BOX, (number // 2, 3))
    drawn = tips(model, load_n, number - len(goals), rng)
    distances = np.concatenate([cKDTree(cloud).query(goals)[0], np.zeros(len(drawn))])
    found = []
    for k, goal in enumerate(np.concatenate([goals, drawn])):
        start = low + (rng.uniform(size=len(low)) if k < len(goals) else 0.0) * (high - low)
        case = Case(model, goal, load_n, start, k >= len(goals))
        solution = answer(case, tuple((start * BAR).tolist()))
        found.append(Beside(case, solution, float(distances[k])))
    return found


def unreached(model: CosseratModel, load_n: Vec3, found: list[Beside]) -> int:
    """Number of those on their target to which no straight path leads from where the search began."""
    met = [each for each in found if each.solution.converged]
    rod, loads = model.setup.rod, model.setup.loads(load_n)
    if loads.is_zero or not met:
        return 0
    scale = load_scale(rod, loads)
    starts = np.array([each.case.seed for each in met])
    ends = np.array([each.solution.actuation for each in met]) / BAR
    stands = walk(rod, loads, scale, starts)
    gone = walk(rod, loads, scale, ends, begin=(starts, stands.moment))
    off_mm = np.linalg.norm(gone.tip - [each.case.goal for each in met], axis=1)
    return int(np.sum(stands.there & ~(gone.there & (off_mm <= WALKED_MM))))


def count(grams: float, number: int, size: int = POSES, seed: int = 16) -> tuple[list[Beside], int]:
    """Print one line for an arm as shipped, one for one with own weight on a tilted base.

    Returns:
        what was found, and the number of `unreached` ones.
    """
    everything, lost = [], 0
    for model, base in zip(models(), ("as shipped", "heavy, tilted"), strict=True):
        rng = np.random.default_rng([seed, int(grams)])
        load_n = (0.0, 0.0, grams * GRAM_N)
        cloud = tips(model, load_n, size, rng)
        found = compare(model, load_n, number, cloud, rng)
        not_there = unreached(model, load_n, found)
        met = sum(each.solution.converged for each in found)
        drawn = [each for each in found if each.case.reachable]
        away = [each for each in found if not each.solution.converged and not each.case.reachable]
        missed = np.array([each.left_mm for each in drawn if not each.solution.converged] or [0.0])
        farther = np.array([each.farther_mm for each in away] or [0.0])
        share = ", ".join(f"{x:.3g}" for x in np.quantile(-farther, QUANTILES))
        print(
            f"clouds stiffflop2 ({base}) {grams:g} g: {len(drawn)} walked tips, "
            f"{sum(missed > AS_NEAR_MM)} missed by more than {AS_NEAR_MM} mm, worst {missed.max():.3g} mm; "
            f"{not_there} of {met} on their target not reached from their start; "
            f"of {len(found) - len(drawn)} targets in the box {len(away)} out of reach, "
            f"{np.sum(farther > AS_NEAR_MM)} farther than the nearest of {len(cloud)} poses, "
            f"worst {max(0.0, float(farther.max())):.3g} mm; nearer by {share} mm at quantiles {QUANTILES}",
            flush=True,
        )
        everything += found
        lost += not_there
    return everything, lost


def main() -> int:
    """Count for three loads; exit 1 when a pose of a cloud is nearer, or a walk does not end on an answer."""
    parser = argparse.ArgumentParser(prog="python -m tests.oracles.clouds")
    parser.add_argument("--cases", type=int, default=1000, help="for each load and arm")
    parser.add_argument("--seed", type=int, default=16)
    given = parser.parse_args()
    held = True
    for grams in LOADS_G:
        found, lost = count(grams, given.cases, seed=given.seed)
        held &= lost == 0 and all(each.farther_mm <= AS_NEAR_MM for each in found)
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
