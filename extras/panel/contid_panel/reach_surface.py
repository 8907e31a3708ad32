"""The reach of a spatial arm as a closed surface around the tips of many actuations.

Tips of random actuations, most of them with axes at their limits, are counted on a grid; the counts are
smoothed, and the surface is where they fall below a level that leaves nearly all tips inside. Vertices are
averages of the crossings along the edges of each cell (surface nets, Gibson 1998). It is a drawing, within
some two cells: `contid reach` computes the reach itself.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.batch import forward_many
from contid.kinematics.frames import in_world
from contid.units import MM_PER_M
from contid_view.robot_scene import RobotScene

#: Actuations, and how many are computed at a time: an order to stop waits for no more.
TIPS: Final = 20000
CHUNK: Final = 20
#: Cells along the widest side, and how many are added around.
CELLS: Final = 24
AROUND: Final = 3
#: Passes of the smoothing (1 4 6 4 1) / 16 along each axis.
PASSES: Final = 2
#: Share of the tips outside the surface.
OUTSIDE: Final = 0.01
SEED: Final = 1
#: Actuators of a section.
SECTION: Final = 3


class ReachSurface(NamedTuple):
    """A triangle mesh.

    Attributes:
        points: vertices in the world frame [mm], (n, 3).
        faces: indices of corners, (m, 3), counter-clockwise seen from outside.
    """

    points: Array
    faces: Array


def reach_surface(robot: RobotScene) -> ReachSurface | None:
    """The surface of a spatial arm; None when its tips do not fill a space."""
    tips = _tips_mm(robot)
    widest = float(np.ptp(tips, axis=0).max()) if len(tips) else 0.0
    if widest <= 0.0:
        return None
    cell = widest / CELLS
    low = tips.min(axis=0) - AROUND * cell
    shape = np.ceil(np.ptp(tips, axis=0) / cell).astype(int) + 2 * AROUND + 1
    places = ((tips - low) / cell).astype(int)
    counts = np.zeros(shape)
    counts[tuple(places.T)] = 1.0
    for _ in range(PASSES):
        for axis in range(3):
            counts = _smoothed(counts, axis)
    level = float(np.quantile(counts[tuple(places.T)], OUTSIDE))
    net = _surface_net(counts - level)
    return ReachSurface(low + (net.points + 0.5) * cell, net.faces)


def _tips_mm(robot: RobotScene) -> Array:
    """Tips in the world frame."""
    model, actuations = robot.config.model, _actuations(robot)
    found = []
    for first in range(0, TIPS, CHUNK):
        table = forward_many(model, actuations[first : first + CHUNK], threads=1)
        found.append(np.asarray(table["tip_m"], dtype=float).reshape(-1, 3))
    tips = np.concatenate(found)
    tips = tips[np.isfinite(tips).all(axis=1)]
    return in_world(robot.config.frame, tips) * MM_PER_M


def _actuations(robot: RobotScene) -> Array:
    """Actuations whose tips fill the reach to its edge, (TIPS, axes).

    Axes are often at their limits; in half of the rows sections do the same, as an arm that is bent one way
    reaches farthest; and rows are drawn towards the rest pose by any share, as a straight arm is long.
    """
    config, numbers = robot.config, np.random.default_rng(SEED)
    low, high = np.array(config.model.lower), np.array(config.model.upper)
    shares = np.clip(1.6 * numbers.random((TIPS, len(low))) - 0.3, 0.0, 1.0)
    if len(low) % SECTION == 0:
        shares[::2] = np.tile(shares[::2, :SECTION], len(low) // SECTION)
    rest = np.array(config.rest)
    towards = np.sqrt(numbers.random((TIPS, 1)))
    towards[::4] = 1.0
    found: Array = rest + towards * (low + shares * (high - low) - rest)
    return found


def _smoothed(values: Array, axis: int) -> Array:
    found = 6.0 * values
    for shift, weight in ((1, 4.0), (2, 1.0)):
        found = found + weight * (np.roll(values, shift, axis) + np.roll(values, -shift, axis))
    return found / 16.0


def _surface_net(field: Array) -> ReachSurface:
    """The surface where a field on a grid is 0; inside it is positive. Points are in cells of the grid."""
    inside = field > 0.0
    corners = [np.array([i, j, k]) for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    sizes = np.array(field.shape) - 1
    total, crossings = np.zeros((*sizes, 3)), np.zeros(tuple(sizes))
    cut = [slice(0, size) for size in sizes]
    grid = np.stack(np.meshgrid(*(np.arange(size) for size in sizes), indexing="ij"), axis=-1)
    for begin in corners:
        for axis in range(3):
            if begin[axis]:
                continue
            end = begin + np.eye(3, dtype=int)[axis]
            a, b = (
                field[tuple(slice(s.start + o, s.stop + o) for s, o in zip(cut, at, strict=True))]
                for at in (begin, end)
            )
            crosses = (a > 0.0) != (b > 0.0)
            share = np.where(crosses, a / np.where(crosses, a - b, 1.0), 0.0)
            place = grid + begin + share[..., None] * np.eye(3)[axis]
            total += np.where(crosses[..., None], place, 0.0)
            crossings += crosses
    cells = np.argwhere(crossings > 0)
    number = np.full(tuple(sizes), -1)
    number[tuple(cells.T)] = np.arange(len(cells))
    points = total[tuple(cells.T)] / crossings[tuple(cells.T)][:, None]
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        here = [slice(1, -1)] * 3
        here[axis] = slice(0, -1)
        there = list(here)
        there[axis] = slice(1, None)
        leaves = inside[tuple(here)] & ~inside[tuple(there)]
        enters = ~inside[tuple(here)] & inside[tuple(there)]
        for mask, order in ((leaves, (0, 1, 2, 3)), (enters, (3, 2, 1, 0))):
            at = np.argwhere(mask) + np.where(np.arange(3) == axis, 0, 1)
            ring = []
            for du, dv in ((1, 1), (0, 1), (0, 0), (1, 0)):
                cell = at.copy()
                cell[:, u] -= du
                cell[:, v] -= dv
                ring.append(number[tuple(cell.T)])
            quads = np.stack([ring[each] for each in order], axis=1)
            faces += [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
    return ReachSurface(points, np.concatenate(faces))
