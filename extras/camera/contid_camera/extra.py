"""The packages of the extra ``contid[track]``."""

from __future__ import annotations

import os
from importlib.util import find_spec

from contid.errors import EXTRAS, ContidError, MissingExtraError


def require_extra() -> None:
    """Refuse to go on without OpenCV.

    Raises:
        ContidError: it is missing, or a build without the detector of tags.
    """
    if find_spec("cv2") is None:
        raise MissingExtraError("a camera", "cv2", EXTRAS["cv2"])
    # Its warnings would repeat in several lines what contid's errors state; read when it is imported.
    os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")
    import cv2

    if not hasattr(cv2, "aruco") or not hasattr(cv2.aruco, "ArucoDetector"):
        raise ContidError(f"OpenCV {cv2.__version__} has no detector of tags: pip install 'contid[track]'")
