"""Writes the bodies of robots into a Rerun recording, as solid cylinders.

Radii and colours are written once, positions with every frame: 32 bytes a cylinder.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from contid_view import paths
from contid_view.body import SolidBody
from contid_view.colours import PLATE, Colour
from contid_view.rerun.stream import RerunStream
from contid_view.robot_scene import RobotDrawing


class RerunBody:
    """The body of one robot in a recording."""

    def __init__(
        self, stream: RerunStream, robot: str, body: SolidBody, colours: tuple[Colour, Colour]
    ) -> None:
        self._stream, self._body = stream, body
        self._entity = paths.body(robot, "body")
        shades = np.array([*colours, PLATE])[body.shades]
        solid = rr.components.FillMode.Solid
        look = rr.Cylinders3D.from_fields(radii=body.radii, colors=shades.astype(np.uint8), fill_mode=solid)
        stream.static(self._entity, look)

    def write(self, ticks: Sequence[int], drawings: Sequence[RobotDrawing | None]) -> None:
        """The body at every tick, or none where the robot is unknown."""
        known = [drawing is not None for drawing in drawings]
        keep = self._stream.changes(self._entity, known)
        if not keep:
            return
        shown = [drawing for drawing in drawings if drawing is not None]
        count = len(self._body)
        centres, quaternions, lengths = np.zeros((0, 3)), np.zeros((0, 4)), np.zeros(0)
        if shown:
            placed = self._body.place(shown)
            centres, lengths = placed.centres.reshape(-1, 3), placed.lengths.ravel()
            quaternions = placed.quaternions.reshape(-1, 4)
        columns = rr.Cylinders3D.columns(
            lengths=lengths.astype(np.float32),
            centers=centres.astype(np.float32),
            quaternions=quaternions.astype(np.float32),
        ).partition([count * known[k] for k in keep])
        self._stream.send(self._entity, [ticks[k] for k in keep], columns)
