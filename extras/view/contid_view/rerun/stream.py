"""A Rerun recording on the time lines of a run: static data, and columns of entities that appear and vanish.

A batch is written column by column (`send_columns`), which costs a tenth of row by row.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from contid.kinematics.array import Array
from contid_view import paths
from contid_view.colours import Colour

#: A line with its colour and its radius on the screen.
Strip = tuple[Array, Colour, float]


class RerunStream:
    """One recording."""

    def __init__(self, recording: rr.RecordingStream, rate_hz: float) -> None:
        self._recording = recording
        self.rate_hz = rate_hz
        #: Whether the last row of an entity shows something. The first row may be empty: the layout has all.
        self._visible: dict[str, bool] = {}

    def static(self, entity: str, what: Any) -> None:
        """Log what never changes."""
        self._recording.log(entity, what, static=True)

    def send(self, entity: str, ticks: Sequence[int], columns: Any) -> None:
        """Log columns, a row per tick."""
        seconds = np.array(ticks) / self.rate_hz
        times = [rr.TimeColumn(paths.TICK, sequence=ticks), rr.TimeColumn(paths.TIME, duration=seconds)]
        self._recording.send_columns(entity, indexes=times, columns=columns)

    def changes(self, entity: str, visible: Sequence[bool]) -> list[int]:
        """Indices of the frames to write: those that show something, and the first that does not."""
        keep = []
        for k, is_visible in enumerate(visible):
            if is_visible or self._visible.get(entity, True):
                keep.append(k)
            self._visible[entity] = is_visible
        return keep

    def lines(self, entity: str, ticks: Sequence[int], lines: Sequence[Array | None], ink: Colour) -> None:
        """One curve per frame, or none."""
        self.strips(entity, ticks, [[] if line is None else [(line, ink, 1.5)] for line in lines])

    def strips(self, entity: str, ticks: Sequence[int], strips: Sequence[Sequence[Strip]]) -> None:
        """The strips of every frame."""
        keep = self.changes(entity, [bool(each) for each in strips])
        if not keep:
            return
        shown = [strip for k in keep for strip in strips[k]]
        columns = rr.LineStrips3D.columns(
            strips=[line.tolist() for line, _, _ in shown],
            colors=[ink for _, ink, _ in shown],
            radii=rr.Radius.ui_points([radius for _, _, radius in shown]) if shown else [],
        ).partition([len(strips[k]) for k in keep])
        self.send(entity, [ticks[k] for k in keep], columns)

    def points(
        self, entity: str, ticks: Sequence[int], points: Sequence[Array], ink: Colour, size: float
    ) -> None:
        """One point per frame, or none where it is not finite; each (1, 3) [mm]."""
        finite = [bool(np.isfinite(point).all()) for point in points]
        keep = self.changes(entity, finite)
        if not keep:
            return
        shown = [points[k] for k in keep if finite[k]]
        columns = rr.Points3D.columns(
            positions=np.vstack(shown) if shown else np.zeros((0, 3)),
            colors=[ink] * len(shown),
            radii=rr.Radius.ui_points([size] * len(shown)) if shown else [],
        ).partition([int(finite[k]) for k in keep])
        self.send(entity, [ticks[k] for k in keep], columns)

    def scalars(self, entity: str, ticks: Sequence[int], values: Any) -> None:
        """Rows of equally many curves; rows with an unknown value are left out."""
        rows = np.asarray(values, dtype=np.float64)
        finite = np.isfinite(rows).all(axis=1)
        if finite.any():
            columns = rr.Scalars.columns(scalars=rows[finite])
            self.send(entity, np.array(ticks)[finite].tolist(), columns)
