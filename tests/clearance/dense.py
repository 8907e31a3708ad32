"""Random pairs of arms against dense sampling, many at a time.

python -m tests.clearance.dense CONFIGURATIONS [--seed N] [--minutes M]
"""

import argparse
import math
import time
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from contid_clearance.body import sampled_body
from contid_clearance.distances import between_bodies

MARGIN_M = 1e-3
FINE, DENSE = 1024, 401
_BATCH = 200


@dataclass
class Counts:
    """What became of the configurations."""

    configurations: int = 0
    accepted: int = 0
    penetrations: int = 0
    penetrations_accepted: int = 0
    nearer_than_bound: int = 0
    falsely_refused: int = 0
    section_pairs: int = 0
    distance_s: float = 0.0

    def __str__(self):
        clear = self.accepted + self.falsely_refused
        each_us = 1e6 * self.distance_s / max(self.section_pairs, 1)
        return (
            f"{self.configurations} configurations, {self.penetrations} penetrations, "
            f"{self.accepted} accepted at {MARGIN_M * 1e3:g} mm: "
            f"{self.penetrations_accepted} penetrations accepted, "
            f"{self.nearer_than_bound} nearer than the bound, {self.falsely_refused} falsely refused "
            f"({100 * self.falsely_refused / max(clear, 1):.3f} % of the clear ones); "
            f"{each_us:.2f} us of processor time per pair of sections"
        )


class Chains:
    """Chains of one to three arcs, all at once; each arc is tangent to the one before."""

    def __init__(self, rng, count, spread_m=0.12):
        self.arcs = rng.integers(1, 4, count)
        self.lengths = rng.uniform(0.02, 0.2, (count, 3)) * (np.arange(3) < self.arcs[:, None])
        angles = rng.uniform(-3.5, 3.5, (count, 3)) * (rng.random((count, 3)) > 0.1)  # some are straight
        planes = rng.uniform(0.0, np.pi, (count, 3))
        self.curvatures = angles / np.maximum(self.lengths, 0.02)
        self.axes = np.stack([np.cos(planes), np.sin(planes), np.zeros_like(planes)], axis=-1)
        self.towards = np.cross(self.axes, [0.0, 0.0, 1.0])
        self.ends = np.concatenate([np.zeros((count, 1)), np.cumsum(self.lengths, axis=1)], axis=1)
        self.origins = [rng.uniform(-spread_m, spread_m, (count, 3))]
        self.frames = [Rotation.random(count, random_state=rng)]
        for k in range(3):
            here = self._local(k, self.lengths[:, k : k + 1])[:, 0]
            self.origins.append(self.origins[-1] + self.frames[-1].apply(here))
            turned = self.axes[:, k] * (self.curvatures[:, k] * self.lengths[:, k])[:, None]
            self.frames.append(self.frames[-1] * Rotation.from_rotvec(turned))

    @property
    def length(self):
        return self.ends[:, -1]

    def at(self, s):
        """Points at arc lengths ``(chains, n)``."""
        found = np.empty((*s.shape, 3))
        for k in range(3):
            mine = s >= self.ends[:, k : k + 1] if k == 0 else s > self.ends[:, k : k + 1]
            points = self._local(k, np.clip(s - self.ends[:, k : k + 1], 0.0, None))
            matrices = self.frames[k].as_matrix()
            moved = np.einsum("cij,cnj->cni", matrices, points) + self.origins[k][:, None]
            found[mine] = moved[mine]
        return found

    def evenly(self, count):
        return self.at(np.linspace(0.0, 1.0, count) * self.length[:, None])

    def one(self, index, s):
        """A point of one chain."""
        return self.at(np.repeat(np.full((1, 1), s), len(self.length), axis=0))[index, 0]

    def _local(self, k, s):
        curvature = self.curvatures[:, k : k + 1]
        straight = np.abs(curvature) < 1e-9
        safe = np.where(straight, 1.0, curvature)
        along = np.where(straight, s, np.sin(safe * s) / safe)
        aside = np.where(straight, 0.0, 2.0 * np.sin(0.5 * safe * s) ** 2 / safe)
        return along[..., None] * np.array([0.0, 0.0, 1.0]) + aside[..., None] * self.towards[:, k][:, None]


def _every(points, count):
    return points[:: FINE // (count - 1)]


def _exact(chains, index, start, spacing):
    """The least centre distance of one pair near a start, by scipy."""
    a, b = chains

    def squared(x):
        return float(np.sum((a.one(index, x[0]) - b.one(index, x[1])) ** 2)) * 1e4

    bounds = [
        (max(0.0, s - h), min(s + h, c.length[index])) for s, h, c in zip(start, spacing, chains, strict=True)
    ]
    return np.sqrt(minimize(squared, start, bounds=bounds, method="L-BFGS-B").fun / 1e4)


def run(configurations, seed, minutes=math.inf):
    """Counts of random configurations, of as many as there is time for."""
    rng, counts = np.random.default_rng(seed), Counts()
    end_s = time.monotonic() + 60.0 * minutes
    while counts.configurations < configurations and time.monotonic() < end_s:
        chains = Chains(rng, _BATCH), Chains(rng, _BATCH)
        radii = rng.uniform(0.002, 0.03, (_BATCH, 2))
        fine = [each.evenly(FINE + 1) for each in chains]
        dense = [each.evenly(DENSE) for each in chains]
        for index in range(min(_BATCH, configurations - counts.configurations)):
            a, b = (
                sampled_body(partial(_every, points[index]), radius)
                for points, radius in zip(fine, radii[index], strict=True)
            )
            begin_s = time.process_time()
            lower = between_bodies(a, b).lower_m
            counts.distance_s += time.process_time() - begin_s
            counts.section_pairs += int(chains[0].arcs[index] * chains[1].arcs[index])
            apart, nearest = cKDTree(dense[1][index]).query(dense[0][index])
            best = int(apart.argmin())
            distance = float(apart[best]) - radii[index].sum()
            if lower < MARGIN_M <= distance:
                spacing = [each.length[index] / (DENSE - 1) for each in chains]
                start = [best * spacing[0], int(nearest[best]) * spacing[1]]
                distance = min(distance, _exact(chains, index, start, spacing) - radii[index].sum())
            counts.configurations += 1
            counts.accepted += lower >= MARGIN_M
            counts.penetrations += distance < 0.0
            counts.penetrations_accepted += lower >= MARGIN_M and distance < 0.0
            counts.nearer_than_bound += distance < lower - 1e-9
            counts.falsely_refused += lower < MARGIN_M <= distance
    return counts


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("configurations", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=math.inf, help="end after so long")
    chosen = parser.parse_args()
    print(run(chosen.configurations, chosen.seed, chosen.minutes))
