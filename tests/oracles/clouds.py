"""Targets of loaded pneumatic arms beside clouds of poses that `rod_walk` gets to.

``python -m tests.oracles.clouds --cases 10000``. Every pose is one that the arm reaches when its pressures
and loads are raised together, so an answer that stays farther from its target than the nearest pose of the
cloud is not the nearest. A cloud is coarse: it is no proof that answers are the nearest, but it needs no
solver. Half the targets are drawn in a box around the arm, half are tips of another cloud, which must be met.
Where an answer is on its target, a walk from the pressures where the search began must end there. Likewise a
pose of the cloud counts against an answer only where the arm gets to it straight from there: poses of a
loaded arm that it reaches from rest can be on another branch of equilibria.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from contid.kinematics.array import Array
from contid.kinematics.cosserat.model import CosseratModel
from contid.targets import Solution, Vec3
from contid.units import BAR, MM_PER_M
from tests.oracles.bounded import BOX, GRAM_N, LOADS_G, QUANTILES, WALKED_MM, Case, answer, models
from tests.oracles.rod_walk import carries, load_scale, walk

Mask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
#: Poses of a cloud, and how many are walked together.
POSES, CHUNK = 20000, 2000
#: Difference of the two discretisations [mm]; an answer that is farther by less is as near.
AS_NEAR_MM = 0.05


@dataclass(frozen=True)
class Cloud:
    """Pressures [bar], shape (n, 3k), that the walk gets to from rest, and their tips [mm], shape (n, 3)."""

    bars: Array
    tips: Array


@dataclass(frozen=True)
class Beside:
    """An answer, and how far the nearest pose of the cloud is from its target [mm], with its pressures [bar].

    A target is reachable in the sense of `Case` where it is the tip of a walked pose.
    """

    case: Case
    solution: Solution
    cloud_mm: float
    cloud_bar: Array

    @property
    def left_mm(self) -> float:
        """The error that the answer reports."""
        return MM_PER_M * self.solution.residual_m

    @property
    def farther_mm(self) -> float:
        """How much nearer the cloud is."""
        return self.left_mm - self.cloud_mm


def poses(model: CosseratModel, load_n: Vec3, number: int, rng: np.random.Generator) -> Cloud:
    """Random pressures, at most ``number`` rows, that the walk gets to; most are at limits."""
    low, high = model.setup.limits.lower, model.setup.limits.upper
    share = np.clip(rng.uniform(-1.0, 2.0, (number, len(low))), 0.0, 1.0)
    bars = low + share * (high - low)
    rod, loads = model.setup.rod, model.setup.loads(load_n)
    scale = load_scale(rod, loads)
    walks = [walk(rod, loads, scale, bars[begin : begin + CHUNK]) for begin in range(0, number, CHUNK)]
    there = np.concatenate([walked.there for walked in walks])
    return Cloud(bars[there], np.concatenate([walked.tip for walked in walks])[there])


def compare(
    model: CosseratModel, load_n: Vec3, number: int, cloud: Cloud, rng: np.random.Generator
) -> list[Beside]:
    """Answers from random pressures to targets in a box, and from rest to as many tips of another cloud."""
    low, high = model.setup.limits.lower, model.setup.limits.upper
    goals = model.setup.rod.reach * rng.uniform(*BOX, (number // 2, 3))
    distances, nearest = cKDTree(cloud.tips).query(goals)
    drawn = poses(model, load_n, number - len(goals), rng)
    found = []
    for goal, distance, k in zip(goals, distances.tolist(), nearest.tolist(), strict=True):
        case = Case(model, goal, load_n, low + rng.uniform(size=len(low)) * (high - low), False)
        found.append(Beside(case, _answer(case), distance, cloud.bars[k]))
    for goal, bar in zip(drawn.tips, drawn.bars, strict=True):
        case = Case(model, goal, load_n, low, True)
        found.append(Beside(case, _answer(case), 0.0, bar))
    return found


def _answer(case: Case) -> Solution:
    return answer(case, tuple((case.seed * BAR).tolist()))


def straight_to(cases: Sequence[Case], bars: Array, tips: Array) -> tuple[Mask, Mask]:
    """Where the arm stands at the start of the searches, and where the straight way on ends with such tips.

    Args:
        cases: of one arm and load.
        bars: pressures at the end of the ways [bar], shape (n, 3k).
        tips: there [mm], shape (n, 3).
    """
    model, load_n = cases[0].model, cases[0].load_n
    rod, loads = model.setup.rod, model.setup.loads(load_n)
    starts = np.array([case.seed for case in cases])
    if not carries(rod, loads):
        return np.full(len(starts), True), np.full(len(starts), True)
    scale = load_scale(rod, loads)
    stands = walk(rod, loads, scale, starts)
    gone = walk(rod, loads, scale, bars, begin=(starts, stands.moment))
    return stands.there, gone.there & (np.linalg.norm(gone.tip - tips, axis=1) <= WALKED_MM)


def unreached(found: Sequence[Beside]) -> int:
    """Number of those on their target to which no straight way leads from where the search began."""
    met = [each for each in found if each.solution.converged]
    if not met:
        return 0
    bars = np.array([each.solution.actuation for each in met]) / BAR
    stands, there = straight_to([each.case for each in met], bars, np.array([each.case.goal for each in met]))
    return int(np.sum(stands & ~there))


def counterexamples(found: Sequence[Beside], cloud: Cloud) -> list[Beside]:
    """Those out of reach that are farther than a pose to which the straight way from their start leads."""
    tree, worse = cKDTree(cloud.tips), []
    for each in found:
        if each.solution.converged or each.case.reachable or each.farther_mm <= AS_NEAR_MM:
            continue
        near = np.array(tree.query_ball_point(each.case.goal, each.left_mm - AS_NEAR_MM), dtype=int)
        _, there = straight_to([each.case] * len(near), cloud.bars[near], cloud.tips[near])
        if there.any():
            near = near[there]
            away = np.linalg.norm(cloud.tips[near] - each.case.goal, axis=1)
            k = int(np.argmin(away))
            worse.append(replace(each, cloud_mm=float(away[k]), cloud_bar=cloud.bars[near[k]]))
    return worse


def count(grams: float, number: int, size: int = POSES, seed: int = 16) -> tuple[list[Beside], int]:
    """Print one line for an arm as shipped, one for one with own weight on a tilted base.

    Returns:
        the `counterexamples` and the walked tips that are missed, and the number of `unreached` ones.
    """
    wrong, lost = [], 0
    for model, base in zip(models(), ("as shipped", "heavy, tilted"), strict=True):
        rng = np.random.default_rng([seed, int(grams)])
        load_n = (0.0, 0.0, grams * GRAM_N)
        cloud = poses(model, load_n, size, rng)
        found = compare(model, load_n, number, cloud, rng)
        not_there = unreached(found)
        met = sum(each.solution.converged for each in found)
        drawn = [each for each in found if each.case.reachable]
        missed = [each for each in drawn if not each.solution.converged and each.left_mm > AS_NEAR_MM]
        away = [each for each in found if not each.solution.converged and not each.case.reachable]
        nearer = np.array([-each.farther_mm for each in away] or [0.0])
        worse = counterexamples(found, cloud)
        share = ", ".join(f"{x:.3g}" for x in np.quantile(nearer, QUANTILES))
        print(
            f"clouds stiffflop2 ({base}) {grams:g} g: {len(drawn)} walked tips, "
            f"{len(missed)} missed by more than {AS_NEAR_MM} mm, "
            f"worst {_most(e.left_mm for e in missed):.3g} mm; "
            f"{not_there} of {met} on their target not reached from their start; "
            f"of {len(found) - len(drawn)} targets in the box {len(away)} out of reach, "
            f"{np.sum(nearer < -AS_NEAR_MM)} farther than the nearest of {len(cloud.tips)} poses, "
            f"{len(worse)} than one straight from their start, "
            f"worst {_most(e.farther_mm for e in worse):.3g} mm; "
            f"nearer by {share} mm at quantiles {QUANTILES}",
            flush=True,
        )
        wrong += worse + missed
        lost += not_there
    return wrong, lost


def _most(values: Iterable[float]) -> float:
    return max(values, default=0.0)


def main() -> int:
    """Count for three loads; exit 1 when a pose of a cloud is nearer, or a walk does not end on an answer."""
    parser = argparse.ArgumentParser(prog="python -m tests.oracles.clouds")
    parser.add_argument("--cases", type=int, default=1000, help="for each load and arm")
    parser.add_argument("--seed", type=int, default=16)
    given = parser.parse_args()
    held = True
    for grams in LOADS_G:
        held &= count(grams, given.cases, seed=given.seed) == ([], 0)
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
