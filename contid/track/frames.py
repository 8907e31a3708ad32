"""Images of a camera or of a file, with the time of their capture."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array

#: A time of capture that a driver gives is taken when it is not older than this [s].
_DRIVER_S: Final = 0.5
_IMAGES: Final = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"})


def frames(source: str, paced: bool = False) -> Iterator[tuple[Array, float]]:
    """Grey images and their times [s].

    Args:
        source: number of a camera, a video, or a folder of images.
        paced: play a video at its own speed; times are then those of `time.monotonic`, as of a camera.

    Yields:
        Image ``(height, width)``, bytes, and its time: of a video from 0, of a camera by `time.monotonic`.

    Raises:
        ContidError: there is no such camera or file, or it cannot be read.
    """
    if source.isdigit():
        yield from _live(int(source))
    elif Path(source).is_dir():
        yield from _images(Path(source))
    else:
        yield from _video(source, paced)


def grey(image: Any) -> Array:
    """An image as grey values."""
    return np.asarray(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))


def _live(number: int) -> Iterator[tuple[Array, float]]:
    capture = cv2.VideoCapture(number)
    try:
        if not capture.isOpened():
            raise ContidError(f"camera {number} cannot be opened: /dev/video{number} is missing or in use")
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # the newest image, not the oldest
        while True:
            got, image = capture.read()
            if not got:
                raise ContidError(f"camera {number} gives no images any more")
            now_s = time.monotonic()
            # V4L2 gives the monotonic time of the capture; other drivers something else.
            captured_s = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
            yield grey(image), captured_s if 0.0 <= now_s - captured_s <= _DRIVER_S else now_s
    finally:
        capture.release()


def _video(source: str, paced: bool) -> Iterator[tuple[Array, float]]:
    if not Path(source).is_file():
        raise ContidError(f"{source}: no such video, and not the number of a camera")
    capture = cv2.VideoCapture(source)
    try:
        if not capture.isOpened():
            raise ContidError(f"{source}: not a video that OpenCV can read")
        period_s = 1.0 / (float(capture.get(cv2.CAP_PROP_FPS)) or 30.0)
        start_s = time.monotonic()
        number = 0
        while True:
            got, image = capture.read()
            if not got:
                break
            at_s = number * period_s
            if paced:
                at_s += start_s
                time.sleep(max(0.0, at_s - time.monotonic()))
            yield grey(image), at_s
            number += 1
        if number == 0:
            raise ContidError(f"{source}: not a video that OpenCV can read")
    finally:
        capture.release()


def _images(folder: Path) -> Iterator[tuple[Array, float]]:
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in _IMAGES)
    if not files:
        raise ContidError(f"{folder}: no images ({', '.join(sorted(_IMAGES))})")
    for number, path in enumerate(files):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise ContidError(f"{path}: not an image that OpenCV can read")
        yield np.asarray(image), number / 30.0
