"""Draws what the tracker sees into the image."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from contid.kinematics.array import Array
from contid.units import MM_PER_M
from contid_camera.body_pose import BodyPose
from contid_camera.camera import Camera
from contid_camera.tracker import Look

_GREEN, _RED, _WHITE = (80, 220, 80), (60, 60, 240), (255, 255, 255)
#: Colours of x, y and z.
_AXES = ((60, 60, 240), (80, 220, 80), (240, 120, 40))
AXIS_M = 0.02
#: Fractions of a pixel that OpenCV draws, as a power of two.
_SHIFT = 4


def drawn(image: Array, look: Look, camera: Camera) -> Array:
    """The image in colour with tags, axes of world and tip, and the tip or why there is none."""
    canvas = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    colour = _GREEN if look.tip is not None else _RED
    for number, each in look.seen.items():
        outline = np.round(each.corners_px * 2**_SHIFT).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(canvas, [outline], True, colour, 1, cv2.LINE_AA, _SHIFT)
        x, y = np.round(each.corners_px.mean(axis=0)).astype(int).tolist()
        cv2.putText(canvas, str(number), (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)
    for pose in (look.world, look.body):
        if pose is not None:
            _axes(canvas, pose, camera)
    if look.tip is None:
        text = look.refusal
    else:
        x_mm, y_mm, z_mm = (value * MM_PER_M for value in look.tip.tip_m)
        sd_mm = look.tip.tip_sd_m * MM_PER_M
        text = f"{x_mm:.1f} {y_mm:.1f} {z_mm:.1f} mm, sd {sd_mm:.2f}, {look.tip.error_px:.2f} px"
    place = (8, canvas.shape[0] - 10)
    cv2.putText(canvas, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(canvas, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, _WHITE, 1, cv2.LINE_AA)
    return np.asarray(canvas)


def _axes(canvas: Any, pose: BodyPose, camera: Camera) -> None:
    ends = np.concatenate([np.zeros((1, 3)), AXIS_M * np.eye(3)])
    turn = cv2.Rodrigues(pose.rotation)[0]
    seen, _ = cv2.projectPoints(ends, turn, pose.origin_m, camera.matrix, camera.coefficients)
    points = np.round(np.asarray(seen).reshape(-1, 2) * 2**_SHIFT)
    if not np.all(np.abs(points) < 2**24):
        return
    origin, *rest = points.astype(int).tolist()
    for end, colour in zip(rest, _AXES, strict=True):
        cv2.line(canvas, origin, end, colour, 2, cv2.LINE_AA, _SHIFT)
