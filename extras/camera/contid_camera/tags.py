"""Finds tags in images, to a few hundredths of a pixel.

The detector's corners are those of a thresholded outline. They are refined by the edges: along every side the
place of the steepest grey value is taken at some points, freed of the distortion of the lens, and a straight
line is fitted; the corners are where the lines meet. Blur moves the corner of a grey square inwards, but not
its edges.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np

from contid.kinematics.array import Array
from contid_camera.camera import Camera

#: A tag whose shortest side is less has no reliable corners [px].
MIN_SIDE_PX: Final = 14.0
#: Points along a side, and the part of it between the first and the last.
_POINTS: Final = 32
_FROM, _TO = 0.1, 0.9
#: Half the width of the search across a side as a share of its length, and its bounds [px].
_ACROSS: Final = 0.08
_ACROSS_PX: Final = (2.0, 5.0)
_STEPS: Final = 17
#: Points farther from their line than this are left out [px].
_OUTLIER_PX: Final = 0.5
#: A side with fewer points is not seen.
_LEAST_POINTS: Final = 16
#: Least difference of grey values across a side.
_LEAST_CONTRAST: Final = 12.0


def family() -> Any:
    """The tags 36h11."""
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


@dataclass(frozen=True, eq=False, slots=True)
class SeenTag:
    """A tag in an image.

    Attributes:
        corners_px: as seen, in the order of `contid_camera.setup_file.CORNERS`, shape ``(4, 2)``.
        ideal_px: where a camera without distortion would see them.
    """

    corners_px: Array
    ideal_px: Array


class TagDetector:
    """Finds the tags of a setup.

    Args:
        camera: that takes the images.
        ids: ids of these tags; others are ignored.
    """

    def __init__(self, camera: Camera, ids: Collection[int]) -> None:
        self._ids = frozenset(ids)
        self._matrix, self._distortion = camera.matrix, camera.coefficients
        options = cv2.aruco.DetectorParameters()
        options.adaptiveThreshWinSizeMin = 9
        options.adaptiveThreshWinSizeMax = 25
        options.adaptiveThreshWinSizeStep = 16
        options.minMarkerPerimeterRate = 0.06
        self._detector = cv2.aruco.ArucoDetector(family(), options)

    def find(self, image: Array) -> dict[int, SeenTag]:
        """The tags by number.

        Args:
            image: grey values, shape ``(height, width)``, bytes.
        """
        found, ids, _ = self._detector.detectMarkers(image)
        numbers = [int(each) for each in np.ravel(ids)] if len(found) else []
        seen: dict[int, SeenTag] = {}
        for number, square in zip(numbers, found, strict=True):
            # The same tag twice: one of them is a reflection or a wrong reading.
            if number not in self._ids or numbers.count(number) > 1:
                continue
            ideal = self._refined(image, np.asarray(square, dtype=float).reshape(4, 2))
            if ideal is not None:
                seen[number] = SeenTag(self._distorted(ideal), ideal)
        return seen

    def _refined(self, image: Array, corners: Array) -> Array | None:
        """The ideal corners from the edges; None where a side is too short or not seen."""
        along = np.roll(corners, -1, axis=0) - corners
        sides = np.linalg.norm(along, axis=1)
        if float(np.min(sides)) < MIN_SIDE_PX:
            return None
        normals = np.stack([-along[:, 1], along[:, 0]], axis=1) / sides[:, None]
        share = np.linspace(_FROM, _TO, _POINTS)
        across = np.linspace(-1.0, 1.0, _STEPS) * float(np.clip(_ACROSS * np.min(sides), *_ACROSS_PX))
        base = corners[:, None] + share[None, :, None] * along[:, None]
        sampled = base[:, :, None] + across[None, None, :, None] * normals[:, None, None]
        grey = cv2.remap(
            image,
            sampled[..., 0].reshape(4 * _POINTS, _STEPS).astype(np.float32),
            sampled[..., 1].reshape(4 * _POINTS, _STEPS).astype(np.float32),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        ).astype(float)
        # The corners run clockwise in the image, so the normals point into the tag, which is darker.
        slope = np.maximum(grey[:, :-1] - grey[:, 1:], 0.0)
        peak = slope.max(axis=1)
        slope[slope < 0.25 * peak[:, None]] = 0.0
        total = slope.sum(axis=1)
        middles = 0.5 * (across[1:] + across[:-1])
        place = (slope @ middles) / np.maximum(total, 1e-9)
        clear = (total > _LEAST_CONTRAST).reshape(4, _POINTS)
        edge = base + place.reshape(4, _POINTS, 1) * normals[:, None]
        ideal = self._undistorted(edge.reshape(-1, 2)).reshape(4, _POINTS, 2)
        lines = [_line(points[good]) for points, good in zip(ideal, clear, strict=True)]
        if any(line is None for line in lines):
            return None
        met = [np.cross(lines[k - 1], lines[k]) for k in range(4)]  # type: ignore[arg-type]
        if any(abs(each[2]) < 1e-6 for each in met):
            return None
        return np.stack([each[:2] / each[2] for each in met])

    def _undistorted(self, points: Array) -> Array:
        ideal = cv2.undistortPoints(
            points.reshape(-1, 1, 2), self._matrix, self._distortion, None, self._matrix
        )
        return np.asarray(ideal, dtype=float).reshape(-1, 2)

    def _distorted(self, points: Array) -> Array:
        rays = np.column_stack([points, np.ones(len(points))]) @ np.linalg.inv(self._matrix).T
        seen, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), self._matrix, self._distortion)
        return np.asarray(seen, dtype=float).reshape(-1, 2)


def _line(points: Array) -> Array | None:
    """The line ``a x + b y + c = 0`` with unit normal through points, outliers left out; None for too few."""
    for _ in range(2):
        if len(points) < _LEAST_POINTS:
            return None
        centre = points.mean(axis=0)
        normal = np.linalg.svd(points - centre, full_matrices=False)[2][1]
        off = np.abs((points - centre) @ normal)
        keep = off <= max(_OUTLIER_PX, 2.5 * float(np.sqrt(np.mean(off**2))))
        if keep.all():
            break
        points = points[keep]
    return np.array([normal[0], normal[1], -float(normal @ centre)])
