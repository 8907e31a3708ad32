"""The camera: pinhole and distortion, in a YAML file that `contid calibrate camera` writes.

    contid_camera: 1
    size_px: [640, 480]
    focal_px: [701.2, 700.9]
    center_px: [322.1, 238.4]
    distortion: [-0.21, 0.05, 0.0004, -0.0002, 0.0]

A point at (x, y, z) in the frame of the camera (x right, y down, z ahead) is seen at ``focal * (x/z, y/z) +
center``, distorted by the Brown model (k1, k2, p1, p2, k3) of OpenCV.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from contid.kinematics.array import Array
from contid.robot_file.base import Positive, Strict

Pixels = Annotated[int, Field(ge=16, le=20_000)]


class Camera(Strict):
    """A calibrated camera.

    Attributes:
        contid_camera: version of the format.
        size_px: width and height of its images.
        focal_px: focal lengths along x and y.
        center_px: principal point.
        distortion: k1, k2, p1, p2, k3.
        error_px: root mean square of the corners of the calibration, for information.
    """

    contid_camera: Literal[1] = 1
    size_px: tuple[Pixels, Pixels]
    focal_px: tuple[Positive, Positive]
    center_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    error_px: float | None = None

    @property
    def matrix(self) -> Array:
        """The 3x3 matrix of the pinhole [px]."""
        (fx, fy), (cx, cy) = self.focal_px, self.center_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def coefficients(self) -> Array:
        """The distortion as an array."""
        return np.array(self.distortion)

    def text(self) -> str:
        """The file of this camera."""
        numbers = {
            "size_px": list(self.size_px),
            "focal_px": [round(value, 3) for value in self.focal_px],
            "center_px": [round(value, 3) for value in self.center_px],
            "distortion": [round(value, 6) for value in self.distortion],
        }
        lines = ["contid_camera: 1", *(f"{key}: {value}" for key, value in numbers.items())]
        return "\n".join(lines + ([] if self.error_px is None else [f"error_px: {self.error_px:.3f}"])) + "\n"
