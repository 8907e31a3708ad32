"""Obstacles of a chain of sections: a potential that redundant axes lower, and a check of the whole body.

Points p of the backbone at a distance d(p) from an obstacle, of a body of radius r that keeps a margin m, add

    F z f((r + m + z - d) / z),   f(x) = x^3 / (1 - x) for 0 < x <= 0.9, a parabola with its curvature beyond

to the distance from home (`contid.kinematics.arc.home`): nothing farther than the zone z outside the margin,
little where the zone begins, and so stiff near the margin that home cannot hold against it. f has a
continuous second derivative, so answers move continuously with the target. Specification of
``contid/kernels/arc/avoid.hpp``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from contid.kinematics.arc import arc
from contid.kinematics.arc.sections import ArcChain
from contid.kinematics.array import Array

#: Points of a section, and at most of a rigid piece.
ALONG: Final = 12
_RIGID: Final = 8
#: A check by samples of the body loses less than this [m].
_SPARE_M: Final = 2e-4
_FINEST_M: Final = 4e-4
#: From there the potential is a parabola.
_STIFFEST: Final = 0.9
#: Zone and force of the potential by the length that scales damping (`Tuning.ell_m`). A narrower zone or a
#: smaller force loses answers between obstacles, larger ones only cost time: benchmarks/obstacles.py.
ZONE: Final = 0.2
FORCE: Final = 0.5


class Potential(NamedTuple):
    """Value [m^2], gradient ``(N,)`` [m], and the never negative part ``(N, N)`` of the second derivative."""

    value: float
    gradient: Array
    stiffness: Array


@dataclass(frozen=True, eq=False)
class Avoid:
    """What a body keeps away from.

    Attributes:
        obstacles: in the base frame, rows as `contid.clearance.obstacles.Obstacle.packed`, ``(n, 17)``.
        radius_m: of the body [m].
        margin_m: least distance of surfaces [m].
        from_m: arc length where the body begins [m].
        zone_m: where the potential begins, outside the margin [m].
        force_m: its scale [m].
    """

    obstacles: Array
    radius_m: float
    margin_m: float
    from_m: float
    zone_m: float
    force_m: float

    def potential(self, sections: ArcChain, lengths: Array) -> Potential:
        """The potential and its derivatives by the lengths."""
        points, jacobians = self._points(sections, lengths)
        size = len(lengths)
        value, gradient, stiffness = 0.0, np.zeros(size), np.zeros((size, size))
        for packed in self.obstacles:
            distance, outwards = _distance(packed, points)
            near = (self.radius_m + self.margin_m + self.zone_m - distance) / self.zone_m
            for k in np.flatnonzero(near > 0.0):
                rise, first, second = _rise(float(near[k]))
                row = outwards[k] @ jacobians[k]
                value += self.force_m * self.zone_m * rise
                gradient -= self.force_m * first * row
                stiffness += self.force_m / self.zone_m * second * np.outer(row, row)
        return Potential(value, gradient, stiffness)

    def clear(self, sections: ArcChain, lengths: Array) -> bool:
        """True when the whole body certainly keeps the margin."""
        enough = self.radius_m + self.margin_m + _SPARE_M
        position, rotation = np.zeros(3), np.eye(3)
        for i, (u, v, L) in enumerate(sections.arcs(lengths)):
            rigid = sections.rigid_m[i]
            for packed in self.obstacles:

                def at(
                    along: float,
                    packed: Array = packed,
                    uvl: tuple[float, float, float] = (u, v, L),
                    position: Array = position,
                    rotation: Array = rotation,
                ) -> float:
                    share = min(along / uvl[2], 1.0) if uvl[2] > 0.0 else 1.0
                    p, r = arc.pose(*(np.array(share * each) for each in uvl))
                    x = position + rotation @ (p + max(along - uvl[2], 0.0) * r[:, 2])
                    return float(_distance(packed, x[None])[0][0])

                begin, end = min(self.from_m, L) if i == 0 else 0.0, L + rigid
                if not _far(at, begin, end, at(begin), at(end), enough):
                    return False
            p, r = arc.pose(u, v, L)
            position = position + rotation @ (p + rigid * r[:, 2])
            rotation = rotation @ r
        return True

    def _points(self, sections: ArcChain, lengths: Array) -> tuple[Array, Array]:
        """Points of the body, ``(n, 3)`` [m], and their Jacobians, ``(n, 3, N)``."""
        position, rotation = np.zeros(3), np.eye(3)
        columns = sections.to_arc.shape[-1]
        before: list[tuple[Array, Array, Array]] = []  # end, its Jacobian and its spin
        points, jacobians = [], []
        for i, (u, v, L) in enumerate(sections.arcs(lengths)):
            rigid = sections.rigid_m[i]
            begin = min(self.from_m / L, 1.0) if i == 0 and L > 0.0 else 0.0
            part = np.arange(1, ALONG + 1) / ALONG
            beyond = min(max(math.ceil(rigid / self.radius_m), 1), _RIGID) if rigid > 0.0 else 0
            share = np.concatenate([begin + (1.0 - begin) * part, np.ones(beyond)])
            fixed = np.concatenate([begin * (1.0 - part), np.zeros(beyond)])
            past = np.concatenate([np.zeros(ALONG), rigid * np.arange(1, beyond + 1) / max(beyond, 1)])
            p, r = arc.pose(share * u, share * v, share * L)
            jp, jw = arc.jacobians(share * u, share * v, share * L)
            jp = share[:, None, None] * jp
            jp[:, :, 2] -= fixed[:, None] * r[:, :, 2]
            jp += past[:, None, None] * np.cross(jw, r[:, :, 2, None], axis=1)
            at = position + (p + past[:, None] * r[:, :, 2]) @ rotation.T
            J = np.zeros((len(at), 3, len(lengths)))
            J[:, :, columns * i : columns * (i + 1)] = rotation @ jp @ sections.to_arc[i]
            for m, (end, linear, spin) in enumerate(before):
                arm = (at - end)[:, :, None]
                J[:, :, columns * m : columns * (m + 1)] = linear + np.cross(spin[None], arm, axis=1)
            points.append(at)
            jacobians.append(J)
            p, r = arc.pose(u, v, L)
            jp, jw = arc.jacobians(u, v, L)
            end = position + rotation @ p
            before.append((end, rotation @ jp @ sections.to_arc[i], rotation @ jw @ sections.to_arc[i]))
            rotation = rotation @ r
            position = end + rigid * rotation[:, 2]
        return np.concatenate(points), np.concatenate(jacobians)


def _rise(x: float) -> tuple[float, float, float]:
    """F and its first two derivatives."""
    at = min(x, _STIFFEST)
    left = 1.0 - at
    first = (3.0 - 2.0 * at) * at * at / (left * left)
    second = (6.0 - 6.0 * at + 2.0 * at * at) * at / (left * left * left)
    more = x - at
    return at**3 / left + more * (first + 0.5 * more * second), first + more * second, second


def _distance(packed: Array, points: Array) -> tuple[Array, Array]:
    """Signed distance of points ``(n, 3)`` from one obstacle [m], and its gradients ``(n, 3)``."""
    kind, point, vector, radius = int(packed[0]), packed[1:4], packed[4:7], float(packed[16])
    r = points - point
    if kind == 0:
        return r @ vector, np.broadcast_to(vector, points.shape)
    if kind == 1:
        squared = float(vector @ vector)
        along = np.zeros(len(r)) if squared == 0.0 else np.clip(r @ vector / squared, 0.0, 1.0)
        out = r - along[:, None] * vector
        distance = np.linalg.norm(out, axis=1) - radius
    else:
        rotation = packed[7:16].reshape(3, 3)
        local = r @ rotation
        over = np.abs(local) - vector
        most = over.max(axis=1)
        distance = np.linalg.norm(np.maximum(over, 0.0), axis=1) + np.minimum(most, 0.0)
        inside = np.eye(3)[over.argmax(axis=1)]  # only the nearest face counts
        over = np.where(most[:, None] > 0.0, np.maximum(over, 0.0), inside)
        out = np.where(local < 0.0, -over, over) @ rotation.T
    size = np.linalg.norm(out, axis=1)
    return distance, out / np.where(size > 0.0, size, 1.0)[:, None]


def _far(
    distance: Callable[[float], float],
    begin: float,
    end: float,
    at_begin: float,
    at_end: float,
    enough: float,
) -> bool:
    """True when a distance that changes no faster than its place stays ``enough`` between two places."""
    if at_begin < enough or at_end < enough:
        return False
    if 0.5 * (at_begin + at_end - (end - begin)) >= enough:
        return True
    if end - begin < _FINEST_M:
        return False
    middle = 0.5 * (begin + end)
    at_middle = distance(middle)
    return _far(distance, begin, middle, at_begin, at_middle, enough) and _far(
        distance, middle, end, at_middle, at_end, enough
    )
