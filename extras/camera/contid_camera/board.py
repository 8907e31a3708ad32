"""Calibrates a camera from images of a chessboard."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import cv2
import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_camera.camera import Camera

#: Fewer images do not separate focal length, distortion and distance.
MIN_IMAGES: Final = 8
MAX_IMAGES: Final = 60
#: An image is used when some corner of the board differs from every used image by this share of the width.
_NEW_SHARE: Final = 0.06
#: A larger error means a board that is not flat, a wrong pattern or blurred images [px].
LARGEST_ERROR_PX: Final = 1.0
#: The corners of all images together must cover this share of the width and of the height of the images.
MIN_COVER: Final = 0.6


def calibrated(
    images: Iterable[Array], columns: int, rows: int, square_m: float
) -> tuple[Camera, int, float]:
    """The camera, the number of images used, and the covered share of the image.

    Args:
        images: grey values, bytes, of one size; those without the board are passed over.
        columns: inner corners of the board along a row.
        rows: inner corners along a column.
        square_m: side of a square; scales the distances only, not the camera.

    Raises:
        ContidError: too few different images, or an implausible result.
    """
    seen: list[Array] = []
    size: tuple[int, int] | None = None
    looked = 0
    for image in images:
        looked += 1
        shape = (image.shape[1], image.shape[0])
        if size is not None and shape != size:
            raise ContidError(f"images of {size[0]} x {size[1]} and of {shape[0]} x {shape[1]} pixels")
        size = shape
        corners = _corners(image, columns, rows)
        if corners is not None and all(_far(corners, other) > _NEW_SHARE * shape[0] for other in seen):
            seen.append(corners)
            if len(seen) == MAX_IMAGES:
                break
    if size is None or len(seen) < MIN_IMAGES:
        raise ContidError(
            f"a board of {columns} x {rows} inner corners was found in {len(seen)} images that differ, of "
            f"{looked}; show it at {MIN_IMAGES} places and angles at least, also near the edges"
        )
    across = np.concatenate(seen)
    cover = float(np.min(np.ptp(across, axis=0) / np.array(size)))
    grid = np.zeros((columns * rows, 3), np.float32)
    grid[:, :2] = np.mgrid[0:columns, 0:rows].T.reshape(-1, 2) * square_m
    points = [each.astype(np.float32).reshape(-1, 1, 2) for each in seen]
    error_px, matrix, distortion, _, _ = cv2.calibrateCamera(
        [grid] * len(points), points, size, np.eye(3), np.zeros(5)
    )
    if not math.isfinite(error_px) or error_px > LARGEST_ERROR_PX:
        raise ContidError(
            f"the corners fit no camera: {error_px:.2f} px off; is the board flat, and are {columns} x "
            f"{rows} its inner corners?"
        )
    k1, k2, p1, p2, k3 = np.ravel(distortion).tolist()
    camera = Camera(
        size_px=size,
        focal_px=(float(matrix[0, 0]), float(matrix[1, 1])),
        center_px=(float(matrix[0, 2]), float(matrix[1, 2])),
        distortion=(k1, k2, p1, p2, k3),
        error_px=float(error_px),
    )
    return camera, len(seen), cover


def _corners(image: Array, columns: int, rows: int) -> Array | None:
    found, corners = cv2.findChessboardCornersSB(image, (columns, rows), flags=cv2.CALIB_CB_ACCURACY)
    return np.asarray(corners, dtype=float).reshape(-1, 2) if found else None


def _far(a: Array, b: Array) -> float:
    return float(np.max(np.linalg.norm(a - b, axis=1)))
