"""The pose of a rigid body from the corners of its tags.

A single square seen from far away has two poses that look nearly alike, mirrored about its line of sight.
Every tag gives both as candidates for the whole body; each is refined with all corners. The best one is
returned with the best one that is really different, for the caller to compare (`alike`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from contid.kinematics.array import Array
from contid_camera.jumps import turn_rad
from contid_camera.setup_file import CORNERS

#: Two poses that differ by less are one [rad].
SAME_RAD: Final = math.radians(5.0)
#: Noise of a coordinate of a corner before anything was measured [px], and its weight in coordinates: one tag
#: leaves only two that show the noise.
PRIOR_NOISE_PX: Final = 0.12
PRIOR_COUNT: Final = 6
#: The same for the choice between poses; one is worse when its sum of squares is by `SURE` of it squared.
USUAL_NOISE_PX: Final = 0.15
SURE: Final = 4.0


@dataclass(frozen=True, eq=False, slots=True)
class BodyPose:
    """A pose of a body in the frame of the camera.

    Attributes:
        rotation: body to camera, shape ``(3, 3)``.
        origin_m: position of the origin of the body in the camera.
        error_px: root mean square of the corners.
        other: the best pose that is really different, None without.
        covariance: covariance of rotation vector and origin [rad, m], shape ``(6, 6)``.
        tags: that were used.
    """

    rotation: Array
    origin_m: Array
    error_px: float
    other: BodyPose | None
    covariance: Array
    tags: tuple[int, ...]


def solve_pose(
    places: Mapping[int, Array], seen: Mapping[int, Array], matrix: Array, near: Array | None = None
) -> BodyPose | None:
    """The pose of a body; None when none of its tags is seen, or none gives a pose.

    Args:
        places: corners of its tags in its frame by number [m], shape ``(4, 3)``.
        seen: corners by number, where a camera without distortion sees them [px], shape ``(4, 2)``.
        matrix: matrix of the camera.
        near: rotation that a pose should be near where two are alike, None without.
    """
    tags = tuple(sorted(places.keys() & seen.keys()))
    if not tags:
        return None
    points = np.concatenate([places[tag] for tag in tags])
    pixels = np.concatenate([seen[tag] for tag in tags])
    candidates: list[BodyPose] = []
    for tag in tags:
        for rotation, origin in _of_square(places[tag], seen[tag], matrix):
            pose = _refined(points, pixels, matrix, rotation, origin, tags)
            if pose is not None and not any(turn_rad(pose.rotation, c.rotation) < 1e-3 for c in candidates):
                candidates.append(pose)
    if not candidates:
        return None
    candidates.sort(key=lambda pose: pose.error_px)
    best = candidates[0]
    others = [c for c in candidates if turn_rad(c.rotation, best.rotation) > SAME_RAD]
    other = others[0] if others else None
    if (
        near is not None
        and other is not None
        and alike(best, other)
        and turn_rad(other.rotation, near) < turn_rad(best.rotation, near)
    ):
        best, other = other, best
    return BodyPose(best.rotation, best.origin_m, best.error_px, other, best.covariance, tags)


def alike(pose: BodyPose, other: BodyPose | None) -> bool:
    """True when the noise of the corners hides the difference of two poses."""
    if other is None:
        return False
    least, most = sorted((pose.error_px, other.error_px))
    worse = 4 * len(pose.tags) * (most**2 - least**2)
    return worse < SURE**2 * max(least, USUAL_NOISE_PX) ** 2


def _of_square(corners: Array, pixels: Array, matrix: Array) -> list[tuple[Array, Array]]:
    """Both poses of a body from one tag: rotation and origin of the body in the camera."""
    side = float(np.linalg.norm(corners[1] - corners[0]))
    found, turns, shifts, _ = cv2.solvePnPGeneric(
        CORNERS * side, pixels.reshape(-1, 1, 2), matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    if not found:
        return []
    x, y = (corners[1] - corners[0]) / side, (corners[0] - corners[3]) / side
    tag_in_body = np.stack([x, y, np.cross(x, y)], axis=1)
    out = []
    for turn, shift in zip(turns, shifts, strict=True):
        rotation = np.asarray(cv2.Rodrigues(turn)[0]) @ tag_in_body.T
        out.append((rotation, np.ravel(shift) - rotation @ corners.mean(axis=0)))
    return out


def _refined(
    points: Array, pixels: Array, matrix: Array, rotation: Array, origin: Array, tags: tuple[int, ...]
) -> BodyPose | None:
    """Levenberg-Marquardt on all corners."""
    turn, shift = cv2.solvePnPRefineLM(
        points, pixels, matrix, None, cv2.Rodrigues(rotation)[0], origin.reshape(3, 1).copy()
    )
    expected, jacobian = cv2.projectPoints(points, turn, shift, matrix, None)
    off = np.asarray(expected, dtype=float).reshape(-1, 2) - pixels
    if not np.all(np.isfinite(off)) or float(np.ravel(shift)[2]) <= 0.0:
        return None
    error_px = math.sqrt(float(np.mean(np.sum(off**2, axis=1))))
    J = np.asarray(jacobian, dtype=float)[:, :6]
    free = off.size - 6
    variance = (float(np.sum(off**2)) + PRIOR_COUNT * PRIOR_NOISE_PX**2) / (free + PRIOR_COUNT)
    try:
        covariance = variance * np.linalg.inv(J.T @ J)
    except np.linalg.LinAlgError:
        return None
    return BodyPose(np.asarray(cv2.Rodrigues(turn)[0]), np.ravel(shift), error_px, None, covariance, tags)
