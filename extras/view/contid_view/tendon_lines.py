"""Discs and tendons of a tendon robot as lines for drawings, in the base frame [m]."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.tendon.geometry import TendonGeometry, TendonSection, forward
from contid.kinematics.tendon.model import TendonModel

#: Discs per section; tendons are straight between them, as real ones are.
DISCS: Final = 5
#: Corners of a drawn disc.
CORNERS: Final = 24
#: Radius of a drawn disc, as a multiple of the distance of the outermost tendon from the backbone.
RIM: Final = 1.2


def tendon_lines(model: TendonModel, pulls: Array) -> list[Array]:
    """Lines of a robot at some pulls.

    Args:
        model: model of the robot.
        pulls: pulls of its tendons [m], shape ``(tendons,)``.

    Returns:
        A line per tendon, from the base disc to the disc where it ends, then a closed line per disc. Each has
        points in the base frame [m], shape ``(points, 3)``.
    """
    geometry = model.geometry
    # A section that bends by Theta is DISCS equal pieces that bend by Theta / DISCS.
    bends_of_pieces = np.repeat(model.bends(pulls).reshape(-1, 2) / DISCS, DISCS, axis=0).ravel()
    discs = forward(_cut(geometry), bends_of_pieces)
    centres = np.concatenate(([[0.0, 0.0, geometry.base_offset_m]], discs.discs_m))
    rotations = np.concatenate(([np.eye(3)], discs.rotations))
    lines = []
    for j, section in enumerate(geometry.sections):
        first = 0 if geometry.through else j * DISCS
        last = (j + 1) * DISCS + 1
        for arm in section.arms:
            lines.append(centres[first:last] + rotations[first:last] @ np.array([*arm, 0.0]))
    rim_m = RIM * max(max(section.radius_m) for section in geometry.sections)
    azimuth = np.linspace(0.0, 2.0 * np.pi, CORNERS + 1)
    circle = rim_m * np.stack((np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)))
    lines += [centre + (rotation @ circle).T for centre, rotation in zip(centres, rotations, strict=True)]
    return lines


def _cut(geometry: TendonGeometry) -> TendonGeometry:
    """The same backbone in pieces from disc to disc; a rigid piece belongs to the last one of its section."""
    pieces: list[TendonSection] = []
    for section in geometry.sections:
        piece = replace(section, length_m=section.length_m / DISCS, rigid_m=0.0)
        pieces += [piece] * (DISCS - 1) + [replace(piece, rigid_m=section.rigid_m)]
    return replace(geometry, sections=tuple(pieces))
