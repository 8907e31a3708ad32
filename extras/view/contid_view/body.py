"""Places the parts of a body along drawn backbones: cylinders in the world, many instants at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.robot import RobotDescription
from contid_view.body_plan import body_plan, section_shares
from contid_view.robot_scene import RobotDrawing, RobotScene
from contid_view.transport import TINY, transported


@dataclass(frozen=True, slots=True)
class Cylinders:
    """The body at several instants, ``n`` instants of ``m`` cylinders; world frame.

    Attributes:
        centres: (n, m, 3) [mm].
        quaternions: (n, m, 4), x y z w; they turn +z to the axis of the cylinder.
        lengths: (n, m) [mm].
    """

    centres: Array
    quaternions: Array
    lengths: Array


class SolidBody:
    """The body of one robot.

    Attributes:
        radii: (m,) [mm].
        shades: (m,), see `contid_view.body_plan.BodyPart`.
    """

    def __init__(self, scene: RobotScene, robot: RobotDescription) -> None:
        self._robot = robot
        parts = body_plan(robot, scene.length_mm)
        self.radii = np.array([part.radius_mm for part in parts])
        self.shades = np.array([part.shade for part in parts])
        self._stations = np.array([[part.begin, part.end] for part in parts])
        self._offsets = np.array([[part.from_mm, part.to_mm] for part in parts])
        base = scene.base
        self._across, self._along = (base[1], base[2]) if scene.planar else (base[1], base[3])

    def __len__(self) -> int:
        return len(self.radii)

    def place(self, drawings: Sequence[RobotDrawing]) -> Cylinders:
        """The cylinders of drawings."""
        lines = np.stack([drawing.backbone for drawing in drawings])
        x, y, z = transported(lines, self._across, self._along)
        shares = np.stack([self._shares(drawing) for drawing in drawings])
        section = np.minimum(self._stations.astype(int), shares.shape[1] - 2)
        within = self._stations - section
        at = shares[:, section] + within * (shares[:, section + 1] - shares[:, section])
        place = np.clip(at, 0.0, 1.0) * (lines.shape[1] - 1)
        ends = _interpolated(lines, place)
        for axes, offset in zip((x, y, z), np.moveaxis(self._offsets, 2, 0), strict=True):
            ends = ends + _interpolated(axes, place) * offset[None, :, :, None]
        return between(ends[:, :, 0], ends[:, :, 1])

    def _shares(self, drawing: RobotDrawing) -> Array:
        shares = np.array(section_shares(self._robot, drawing.actuation))
        if isinstance(self._robot, Cosserat) and drawing.sections == len(shares) - 1 == 2:
            # Its sections stretch; the drawing is cut at the end of the first one.
            first = len(drawing.strips[0])
            shares[1] = (first - 1) / (first + len(drawing.strips[1]) - 2)
        return shares


def between(begin: Array, end: Array) -> Cylinders:
    """Cylinders from points to points, each (n, m, 3) [mm]."""
    axis = end - begin
    lengths = np.linalg.norm(axis, axis=2)
    i, j, k = np.moveaxis(axis / np.maximum(lengths, TINY)[..., None], 2, 0)
    # Half of the turn from +z: (0, 0, 1) x axis and 1 + cosine, normalised; -z is a half turn about x.
    w = 1.0 + k
    opposite = w < 1e-9
    quaternions = np.stack(
        [np.where(opposite, 1.0, -j), np.where(opposite, 0.0, i), np.zeros_like(i), w], axis=2
    )
    quaternions /= np.linalg.norm(quaternions, axis=2, keepdims=True)
    return Cylinders(0.5 * (begin + end), quaternions, lengths)


def quaternion_of(rotation: Array) -> list[float]:
    """Quaternion (x, y, z, w) of a rotation matrix (S. W. Shepperd, J. Guidance and Control 1(3), 1978)."""
    trace = float(np.trace(rotation))
    four = np.array([1.0 + 2.0 * rotation[k, k] - trace for k in range(3)] + [1.0 + trace])
    # Products of two components, over the greatest of them.
    skew = rotation - rotation.T
    products = rotation + rotation.T
    np.fill_diagonal(products, four[:3])
    last = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    table = np.block([[products, last[:, None]], [last[None], four[3:, None]]])
    row = table[int(np.argmax(four))]
    return list(row / np.linalg.norm(row))


def _interpolated(values: Array, place: Array) -> Array:
    """Values (n, points, 3) at fractional numbers of points (n, m, 2): (n, m, 2, 3)."""
    low = np.minimum(place.astype(int), values.shape[1] - 2)
    share = (place - low)[..., None]
    rows = np.arange(len(values))[:, None, None]
    return np.asarray(values[rows, low] * (1.0 - share) + values[rows, low + 1] * share)
