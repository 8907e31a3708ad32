"""Arrays of points, vectors and matrices between the world and a base frame.

Sums of points and vectors are in the order of `BaseFrame`, so that a row of an array and a single target give
the same numbers bit for bit; matrices are products of NumPy. Planar robots have two columns: z is 0.
"""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.frames import BaseFrame


class PlacedRows:
    """The base frame of a robot applied to arrays.

    Args:
        frame: pose of the base in the world.
        dimension: d, the columns of points in the world: 2 for planar robots, else 3.

    Attributes:
        dimension: d.
    """

    def __init__(self, frame: BaseFrame, dimension: int) -> None:
        #: Rotation matrix from the base to the world, its nine numbers row by row.
        self._r = frame.rotation
        self._matrix = np.array(frame.rotation).reshape(3, 3)
        self._origin = frame.origin_in_world
        self.dimension = dimension

    def points_in_base(self, points: Array) -> Array:
        """Points of the world ``(N, d)`` [m] in the base frame ``(N, 3)`` [m]."""
        x, y, z = self._columns(points)
        ox, oy, oz = self._origin
        return self._to_base(x - ox, y - oy, z - oz)

    def vectors_in_base(self, vectors: Array) -> Array:
        """Directions or forces of the world, ``(N, d)`` or ``(N, 3)``, in the base frame, ``(N, 3)``."""
        return self._to_base(*self._columns(vectors))

    def points_in_world(self, points: Array) -> Array:
        """Points of the base frame ``(..., 3)`` [m] in the world ``(..., d)`` [m]."""
        world = self._to_world(points)
        for axis, origin in enumerate(self._origin):
            world[..., axis] += origin
        return world[..., : self.dimension]

    def vectors_in_world(self, vectors: Array) -> Array:
        """Directions of the base frame, ``(..., 3)``, in the world, ``(..., d)``."""
        return self._to_world(vectors)[..., : self.dimension]

    def columns_in_world(self, matrices: Array) -> Array:
        """Matrices ``(..., 3, n)`` whose columns are vectors of the base frame, in the world."""
        turned: Array = self._matrix @ matrices
        return turned

    def columns_in_base(self, matrices: Array) -> Array:
        """Matrices ``(..., 3, n)`` whose columns are vectors of the world, in the base frame."""
        turned: Array = self._matrix.T @ matrices
        return turned

    def tensors_in_world(self, tensors: Array) -> Array:
        """Tensors ``(..., 3, 3)`` of the base frame, such as compliances, in the world: ``R T R^T``."""
        turned: Array = self._matrix @ tensors @ self._matrix.T
        return turned

    def _columns(self, rows: Array) -> tuple[Array, Array, Array]:
        z = rows[:, 2] if rows.shape[1] == 3 else np.zeros(len(rows))
        return rows[:, 0], rows[:, 1], z

    def _to_base(self, x: Array, y: Array, z: Array) -> Array:
        r = self._r
        return np.stack([r[k] * x + r[3 + k] * y + r[6 + k] * z for k in range(3)], axis=1)

    def _to_world(self, rows: Array) -> Array:
        r = self._r
        x, y, z = rows[..., 0], rows[..., 1], rows[..., 2]
        return np.stack([r[k] * x + r[k + 1] * y + r[k + 2] * z for k in (0, 3, 6)], axis=-1)
