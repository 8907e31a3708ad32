"""Rows of frames as columns of Rerun's entities: curves, strips and points that appear and vanish.

A batch is written column by column (`send_columns`), which costs a tenth of row by row.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import rerun as rr

from contid.view.colours import Colour
from contid.view.rerun_stream import RerunStream
from contid.view.robot_scene import Array

#: A line with its colour and its radius on the screen.
Strip = tuple[Array, Colour, float]


class RerunRows:
    """Writes the rows of one recording.

    Args:
        stream: the recording.
        shown: entities that the layout shows of every robot; they exist even if their first row is empty.
    """

    def __init__(self, stream: RerunStream, shown: Iterable[str]) -> None:
        self._stream = stream
        #: Entities whose last row shows something.
        self._visible = dict.fromkeys(shown, True)

    def lines(self, entity: str, ticks: Sequence[int], lines: Sequence[Array | None], ink: Colour) -> None:
        """One curve per frame, or none."""
        self.strips(entity, ticks, [[] if line is None else [(line, ink, 1.5)] for line in lines])

    def strips(self, entity: str, ticks: Sequence[int], strips: Sequence[Sequence[Strip]]) -> None:
        """The strips of every frame."""
        keep = self._changes(entity, [bool(each) for each in strips])
        if not keep:
            return
        shown = [strip for k in keep for strip in strips[k]]
        columns = rr.LineStrips3D.columns(
            strips=[line.tolist() for line, _, _ in shown],
            colors=[ink for _, ink, _ in shown],
            radii=rr.Radius.ui_points([radius for _, _, radius in shown]) if shown else [],
        ).partition([len(strips[k]) for k in keep])
        self._stream.send(entity, [ticks[k] for k in keep], columns)

    def points(
        self, entity: str, ticks: Sequence[int], points: Sequence[Array], ink: Colour, size: float
    ) -> None:
        """One point per frame, or none."""
        finite = [bool(np.isfinite(point).all()) for point in points]
        keep = self._changes(entity, finite)
        if not keep:
            return
        shown = [points[k] for k in keep if finite[k]]
        columns = rr.Points3D.columns(
            positions=np.vstack(shown) if shown else np.zeros((0, 3)),
            colors=[ink] * len(shown),
            radii=rr.Radius.ui_points([size] * len(shown)) if shown else [],
        ).partition([int(finite[k]) for k in keep])
        self._stream.send(entity, [ticks[k] for k in keep], columns)

    def scalars(self, entity: str, ticks: Sequence[int], values: Any) -> None:
        """Rows of equally many curves; rows with an unknown value are left out."""
        rows = np.asarray(values, dtype=np.float64)
        finite = np.isfinite(rows).all(axis=1)
        if finite.any():
            self._stream.send(
                entity, np.array(ticks)[finite].tolist(), rr.Scalars.columns(scalars=rows[finite])
            )

    def _changes(self, entity: str, visible: Sequence[bool]) -> list[int]:
        """Indices of the frames to write: those that show something, and the first that does not."""
        keep = []
        for k, is_visible in enumerate(visible):
            if is_visible or self._visible.get(entity, False):
                keep.append(k)
            self._visible[entity] = is_visible
        return keep
