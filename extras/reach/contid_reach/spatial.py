"""Reach of a tip: the voxels, or squares of a plane, whose centres the inverse kinematics reaches.

Random actuations alone cover the rim of the reachable set poorly. Here they only seed a flood fill over the
voxels of a world-aligned grid; the model's inverse decides whether a centre is reachable. The volume is the
number of reachable voxels, its uncertainty half the volume of those at the boundary. The random generator has
a fixed seed: the same file gives the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from contid.kinematics.batch import Targets, inverse_many
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import Model
from contid.targets import Actuation, Target

Voxel = tuple[int, int, int]
#: Called with the number of voxels tested so far.
Progress = Callable[[int], None]

_SEED: Final = 20171205
#: +x, -x, +y, -y, +z, -z.
_NEIGHBOURS: Final[list[Voxel]] = [
    (sign * (axis == 0), sign * (axis == 1), sign * (axis == 2)) for axis in range(3) for sign in (1, -1)
]


@dataclass(frozen=True, slots=True)
class Volume:
    """The reachable set of one tip.

    Attributes:
        answers: actuation with which the tip is at the centre of a reachable voxel [m or Pa], by its integer
            coordinates; the centre of voxel v is ``v * edge_m``.
        edge_m: edge of a voxel [m].
        rim: number of reachable voxels with a neighbour that is not.
    """

    answers: Mapping[Voxel, Actuation]
    edge_m: float
    rim: int

    @property
    def voxels(self) -> Set[Voxel]:
        """The reachable voxels."""
        return self.answers.keys()

    @property
    def volume_m3(self) -> float:
        """Volume of the reachable voxels [m^3]."""
        return len(self.voxels) * self.edge_m**3

    @property
    def uncertainty_m3(self) -> float:
        """Half the volume of the rim [m^3]."""
        return 0.5 * self.rim * self.edge_m**3

    def bounds_m(self) -> list[list[float]]:
        """Minimum and maximum corner of the reachable set [m]."""
        centres = np.array(list(self.voxels), dtype=float).reshape(-1, 3)
        if not len(centres):
            return [[0.0] * 3, [0.0] * 3]
        corners = np.stack([centres.min(axis=0) - 0.5, centres.max(axis=0) + 0.5]) * self.edge_m
        return [[float(value) for value in corner] for corner in corners]


def sample_tips(model: Model, frame: BaseFrame, samples: int) -> tuple[list[Actuation], NDArray[np.float64]]:
    """Random actuations and their tips in the world, shape ``(samples, 3)`` [m].

    Every axis is at one of its limits in a third of the samples: such poses form the rim of the reach.
    """
    rng = np.random.default_rng(_SEED)
    low, high = np.array(model.lower), np.array(model.upper)
    unit = rng.random((samples, len(low)))
    unit = np.clip(1.5 * unit - 0.25, 0.0, 1.0)
    actuations: list[Actuation] = []
    tips = np.empty((samples, 3))
    for row, actuation in enumerate((low + unit * (high - low)).tolist()):
        # The inverse also applies the limits that couple axes (curvature, rack length).
        inside = model.inverse(Target(actuation=tuple(actuation)), tuple(actuation)).actuation
        actuations.append(inside)
        tips[row] = frame.point_in_world(model.forward(inside).tip_m)
    return actuations, tips


def reachable_volume(
    model: Model,
    frame: BaseFrame,
    *,
    edge_m: float | None = None,
    across: int = 24,
    samples: int = 400,
    progress: Progress | None = None,
    planar: bool = False,
) -> Volume:
    """Flood fill the voxels that the inverse reaches.

    Args:
        model: kinematics in the base frame.
        frame: pose of the base in the world.
        edge_m: edge of a voxel; None gives the widest side ``across`` voxels.
        across: see ``edge_m``.
        samples: random actuations that seed the fill.
        progress: called with the number of voxels tested so far.
        planar: fill the squares of one plane of constant z, the layer of voxels that the base is in.
    """
    neighbours = _NEIGHBOURS[:4] if planar else _NEIGHBOURS
    actuations, tips = sample_tips(model, frame, samples)
    if edge_m is None:
        edge_m = float(np.max(np.ptp(tips, axis=0))) / across
    seeds: dict[Voxel, Actuation] = {}
    for actuation, tip in zip(actuations, tips, strict=True):
        seeds.setdefault(_voxel(tip, edge_m), actuation)
    tested: set[Voxel] = set()
    answers: dict[Voxel, Actuation] = {}
    # A front at a time: its voxels are independent of each other.
    front = dict(sorted(seeds.items()))
    while front:
        centres = [frame.point_in_base((i * edge_m, j * edge_m, k * edge_m)) for i, j, k in front]
        found = inverse_many(model, Targets.of(centres), list(front.values())).rows
        tested.update(front)
        if progress is not None:
            progress(len(tested))
        following: dict[Voxel, Actuation] = {}
        rows = zip(front, found["converged"].tolist(), found["actuation"].tolist(), strict=True)
        for voxel, converged, actuation in rows:
            if converged:
                answers[voxel] = tuple(actuation)
                for step in neighbours:
                    neighbour = _next(voxel, step)
                    if neighbour not in tested:
                        following.setdefault(neighbour, tuple(actuation))
        front = following
    rim = sum(any(_next(voxel, step) not in answers for step in neighbours) for voxel in answers)
    return Volume(answers, edge_m, rim)


def shared(volumes: Mapping[str, Volume]) -> dict[tuple[str, str], float]:
    """Common volume of every two robots [m^3]; all volumes must have the same edge."""
    return {
        (a, b): len(volumes[a].voxels & volumes[b].voxels) * volumes[a].edge_m ** 3
        for a, b in combinations(volumes, 2)
    }


def _voxel(point: NDArray[np.float64], edge_m: float) -> Voxel:
    i, j, k = np.round(point / edge_m).astype(int).tolist()
    return i, j, k


def _next(voxel: Voxel, step: Voxel) -> Voxel:
    return voxel[0] + step[0], voxel[1] + step[1], voxel[2] + step[2]
