"""Tags as images to print."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from contid.errors import ContidError
from contid_camera.setup_file import read_tags
from contid_camera.tags import family

#: Pixels of a bit; a tag has 8 bits a side, and a white border of one.
_BIT_PX: Final = 40


def write_tags(setup: Path, folder: Path) -> Iterator[str]:
    """Write the tags of a setup into a folder; one line for each, with its size.

    Raises:
        ContidError: the setup is wrong, or the folder cannot be written.
    """
    for tag in read_tags(setup):
        image = cv2.aruco.generateImageMarker(family(), tag.id, 8 * _BIT_PX)
        framed = np.pad(np.asarray(image), _BIT_PX, constant_values=255)
        path = folder / f"tag{tag.id}.png"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            path.write_bytes(cv2.imencode(".png", framed)[1].tobytes())
        except OSError as error:
            raise ContidError(f"{path}: cannot be written: {error.strerror}") from None
        whole_mm = tag.size_mm * 10 / 8
        yield f"{path}: print {whole_mm:g} mm wide, its black square is then {tag.size_mm:g} mm"
