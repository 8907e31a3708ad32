"""The setup of a tracker: which camera, which tags are fixed, which are on the tip.

    contid_track: 1
    camera: camera.yaml
    world:
      - {id: 0, size_mm: 60, x_mm: -80, y_mm: 20, z_mm: 0}
    tip: [{id: 10, size_mm: 24, x_mm: 0, y_mm: -12, z_mm: -20, roll_deg: 90}]

A pose is that of a tag: x to the right of the printed tag, y up, z out of its face. Those of ``world`` are
in the world frame, those of ``tip`` in the frame of the tip: origin at the tip, z along the direction of the
body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import Field, model_validator

from contid.kinematics.array import Array
from contid.robot_file.base import Placement, Positive, Strict
from contid.robot_file.findings import validated
from contid.robot_file.positions import read_document, read_text
from contid.units import MM_PER_M
from contid_camera.camera import Camera

#: Tags of the family 36h11.
MAX_ID = 586
#: Corners of a tag of size 1, in the order of the detector: top left, top right, bottom right, bottom left.
CORNERS = np.array([[-0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, -0.5, 0.0], [-0.5, -0.5, 0.0]])


class TagPlace(Placement):
    """A printed tag and the pose of its centre, rotated as the base of a robot is.

    Attributes:
        id: number of the tag in the family 36h11.
        size_mm: side of its black square.
    """

    id: Annotated[int, Field(ge=0, le=MAX_ID)]
    size_mm: Annotated[float, Field(ge=1.0, le=1e4)]

    @property
    def corners_m(self) -> Array:
        """Its corners in the frame that the pose is in, shape ``(4, 3)``."""
        corners = CORNERS * (self.size_mm / MM_PER_M)
        return np.asarray(corners @ np.array(self.rotation).reshape(3, 3).T + np.array(self.position_m))


class Gate(Strict):
    """Bounds beyond which a pose is refused.

    Attributes:
        error_px: greatest root mean square distance of the corners of a body from their projected places.
        tip_sd_mm: greatest standard deviation of the tip, from the geometry and the noise of the corners.
        speed_mm_s: no tip is faster.
        turn_deg_s: no tip turns faster.
        jump_mm: distance that a tip may move between images in addition to that of its speed limit.
        lost: number of refused poses in a row after which poses are accepted again, if they agree.
    """

    error_px: Positive = 0.7
    tip_sd_mm: Positive = 0.25
    speed_mm_s: Positive = 300.0
    turn_deg_s: Positive = 360.0
    jump_mm: Positive = 0.8
    lost: Annotated[int, Field(ge=2, le=1000)] = 15


class TrackSetup(Strict):
    """A whole setup.

    Attributes:
        contid_track: version of the format.
        camera: file of the camera, relative to the folder of this file.
        world: tags that do not move; one at least.
        tip: tags on the tip; one at least.
        gate: bounds beyond which a pose is refused.
    """

    contid_track: Literal[1]
    camera: str
    world: Annotated[tuple[TagPlace, ...], Field(min_length=1)]
    tip: Annotated[tuple[TagPlace, ...], Field(min_length=1)]
    gate: Gate = Gate()

    @model_validator(mode="after")
    def _once(self) -> TrackSetup:
        ids = [tag.id for tag in (*self.world, *self.tip)]
        twice = sorted({each for each in ids if ids.count(each) > 1})
        if twice:
            raise ValueError(f"every tag has a place of its own; twice: {', '.join(map(str, twice))}")
        return self


@dataclass(frozen=True, slots=True)
class LoadedSetup:
    """A setup with its camera."""

    setup: TrackSetup
    camera: Camera


def read_setup(path: Path) -> LoadedSetup:
    """The setup of a file, and its camera.

    Raises:
        BadInputError: mistakes, with their places.
        ContidError: a file cannot be read.
    """
    setup = _read(path, TrackSetup)
    return LoadedSetup(setup, read_camera(path.parent / setup.camera))


def read_tags(path: Path) -> tuple[TagPlace, ...]:
    """All tags of a setup, whose camera may not exist yet; raises as `read_setup`."""
    setup = _read(path, TrackSetup)
    return (*setup.world, *setup.tip)


def read_camera(path: Path) -> Camera:
    """The camera of a file.

    Raises:
        BadInputError: mistakes, with their places.
        ContidError: the file cannot be read.
    """
    return _read(path, Camera)


def corners_of(tags: Sequence[TagPlace]) -> dict[int, Array]:
    """Corners by tag [m]."""
    return {tag.id: tag.corners_m for tag in tags}


_Kind = TypeVar("_Kind", bound=Strict)


def _read(path: Path, kind: type[_Kind]) -> _Kind:
    return validated(read_document(read_text(path), str(path)), kind)
