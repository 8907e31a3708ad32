"""How far two curves in a plane that cross reach beyond each other.

A distance does not show whether two lines touch or have run through each other: it is 0 either way. Of two
lines that cross, each has a part beyond the crossing. The farthest that a point of this part is from the
other line is what it has to be drawn back by; the smaller of the two is the depth of the crossing.
"""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array
from contid_clearance.body import Body


def crossed_m(a: Body, b: Body) -> float:
    """Upper bound of the depth [m] by which centre lines in the plane of x and y cross; 0 without one."""
    p, q = a.points[:, :2], b.points[:, :2]
    at_a, at_b = _crossings(p, q)
    if not len(at_a):
        return 0.0
    between = sum(each.off_m + each.off_pieces_m() for each in (a, b))
    beyond_a, beyond_b = _beyond(p, float(at_a.min())), _beyond(q, float(at_b.min()))
    return min(_farthest(beyond_a, q), _farthest(beyond_b, p)) + between


def _crossings(p: Array, q: Array) -> tuple[Array, Array]:
    """Where two polylines ``(n, 2)`` cross: the parameters of both, pieces from the start, shape ``(k,)``."""
    u, v = (p[1:] - p[:-1])[:, None], (q[1:] - q[:-1])[None]
    r = q[None, :-1] - p[:-1, None]
    area = _cross(u, v)
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = _cross(r, v) / area, _cross(r, u) / area
    i, j = np.nonzero((s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0))
    return i + s[i, j], j + t[i, j]


def _cross(u: Array, v: Array) -> Array:
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])


def _beyond(points: Array, at: float) -> Array:
    """The points of a polyline from a parameter on to its end."""
    k = min(int(at), len(points) - 2)
    return np.vstack([points[k] + (at - k) * (points[k + 1] - points[k]), points[k + 1 :]])


def _farthest(points: Array, line: Array) -> float:
    """Greatest distance of points ``(n, 2)`` from a polyline [m]."""
    u, r = (line[1:] - line[:-1])[None], points[:, None] - line[None, :-1]
    along = np.clip((r * u).sum(axis=2) / np.maximum((u * u).sum(axis=2), 1e-300), 0.0, 1.0)
    return float(np.linalg.norm(r - along[..., None] * u, axis=2).min(axis=1).max())
