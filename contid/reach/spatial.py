"""Reach of arms in space: the voxels whose centres the inverse kinematics can meet.

Sampling actuations alone fills the middle and starves the rim. Here samples only find where the reachable
set is; from there a flood over the voxels of a world-aligned grid asks the model's own inverse whether each
centre is reachable, and stops where it is not. The volume is the count of such voxels; its uncertainty is the
shell of voxels that the boundary cuts, which is reported beside it. Everything is seeded: the same file gives
the same numbers.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import Model
from contid.targets import Actuation, Target, Vec3

Voxel = tuple[int, int, int]
Progress = Callable[[int], None]

_SEED: Final = 20171205
_NEIGHBOURS: Final[tuple[Voxel, ...]] = (
    (1, 0, 0),
    (-1, 0, 0),
    (0, 1, 0),
    (0, -1, 0),
    (0, 0, 1),
    (0, 0, -1),
)


@dataclass(frozen=True, slots=True)
class Volume:
    """Where one tip can go.

    Attributes:
        voxels: reachable voxels by integer coordinates; the centre of voxel v is ``v * edge_m``.
        edge_m: edge of a voxel [m].
        rim: how many of them have a neighbour that is not reachable.
        tested: inverse solutions asked for.
    """

    voxels: frozenset[Voxel]
    edge_m: float
    rim: int
    tested: int

    @property
    def volume_m3(self) -> float:
        """Volume of the reachable voxels [m^3]."""
        return len(self.voxels) * self.edge_m**3

    @property
    def uncertainty_m3(self) -> float:
        """Half the volume of the rim: what the size of the voxels leaves open [m^3]."""
        return 0.5 * self.rim * self.edge_m**3

    def bounds_m(self) -> tuple[Vec3, Vec3]:
        """Least and greatest corner of the reachable set [m]."""
        if not self.voxels:
            return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        corners = np.array(list(self.voxels), dtype=float)
        low, high = (corners.min(axis=0) - 0.5) * self.edge_m, (corners.max(axis=0) + 0.5) * self.edge_m
        return (float(low[0]), float(low[1]), float(low[2])), (
            float(high[0]),
            float(high[1]),
            float(high[2]),
        )


def sample_tips(model: Model, frame: BaseFrame, samples: int) -> tuple[list[Actuation], NDArray[np.float64]]:
    """Random actuations and their tips in the world, shape ``(samples, 3)`` [m].

    Every axis sits at one of its limits a third of the time: the rim of the reach is made of such poses.
    """
    rng = np.random.default_rng(_SEED)
    low, high = np.array(model.lower), np.array(model.upper)
    unit = rng.random((samples, len(low)))
    unit = np.clip(1.5 * unit - 0.25, 0.0, 1.0)
    actuations: list[Actuation] = []
    tips = np.empty((samples, 3))
    for row, actuation in enumerate((low + unit * (high - low)).tolist()):
        # Through the inverse, so that limits beyond the box (curvature, rack length) hold as well.
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
) -> Volume:
    """Flood the voxels that the inverse can meet.

    Args:
        model: kinematics in the base frame.
        frame: of the base in the world.
        edge_m: edge of a voxel; chosen so that the widest side has ``across`` voxels when left out.
        across: see ``edge_m``.
        samples: random actuations that find where to begin.
        progress: called with the number of voxels tested so far.
    """
    actuations, tips = sample_tips(model, frame, samples)
    if edge_m is None:
        edge_m = float(np.ptp(tips, axis=0).max()) / across
    seeds: dict[Voxel, Actuation] = {}
    for actuation, tip in zip(actuations, tips, strict=True):
        seeds.setdefault(_voxel(tip, edge_m), actuation)
    reachable: dict[Voxel, bool] = {}
    queue = deque(sorted(seeds.items()))
    while queue:
        voxel, seed = queue.popleft()
        if voxel in reachable:
            continue
        centre = (voxel[0] * edge_m, voxel[1] * edge_m, voxel[2] * edge_m)
        found = model.inverse(Target(tip_m=frame.point_in_base(centre)), seed)
        reachable[voxel] = found.converged
        if progress is not None and len(reachable) % 256 == 0:
            progress(len(reachable))
        if found.converged:
            queue.extend((_next(voxel, step), found.actuation) for step in _NEIGHBOURS)
    inside = frozenset(voxel for voxel, yes in reachable.items() if yes)
    rim = sum(any(_next(voxel, step) not in inside for step in _NEIGHBOURS) for voxel in inside)
    return Volume(inside, edge_m, rim, len(reachable))


def shared(volumes: Mapping[str, Volume]) -> dict[tuple[str, str], float]:
    """Volume that every two robots can both reach [m^3]; all volumes must have one edge."""
    return {
        (a, b): len(volumes[a].voxels & volumes[b].voxels) * volumes[a].edge_m ** 3
        for a, b in combinations(volumes, 2)
    }


def _voxel(point: NDArray[np.float64], edge_m: float) -> Voxel:
    i, j, k = np.round(point / edge_m).astype(int).tolist()
    return i, j, k


def _next(voxel: Voxel, step: Voxel) -> Voxel:
    return voxel[0] + step[0], voxel[1] + step[1], voxel[2] + step[2]
