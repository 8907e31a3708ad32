"""Results of `contid.Robot` as record arrays whose fields have types: a checker sees arrays, not `Any`."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from contid.html import html_table
from contid.kinematics.array import Array

#: Rows that a notebook shows.
_SHOWN: Final = 10


class TypedRecords(np.recarray[Any, Any]):
    """Record arrays that a notebook shows as a table, of the first ten rows."""

    def _repr_html_(self) -> str:
        names, rows = self.dtype.names or (), self.reshape(-1)
        caption = f"shape {self.shape}" + (f", the first {_SHOWN} rows" if len(rows) > _SHOWN else "")
        shown = zip(*(rows[name][:_SHOWN].tolist() for name in names), strict=True)
        return html_table(caption, names, shown)


class PoseRecords(TypedRecords):
    """What `contid.Robot.fk` returns: one entry per row, shapes ``(..., columns)``.

    Attributes:
        tip: position in the world frame.
        direction: unit tangent there.
        mid: end of the first section.
        rotation: frame of the tip, shape ``(..., 3, 3)``.
        stable: False for a buckled rod.
    """

    tip: Array
    direction: Array
    mid: Array
    rotation: Array
    stable: NDArray[np.bool_]


class AnswerRecords(TypedRecords):
    """What `contid.Robot.ik` returns: one entry per row, shapes ``(..., columns)``.

    Attributes:
        actuation: inside the limits.
        residual: distance to the target.
        converged: the answer meets the target.
        limited_by: a bit for every limit that binds.
        iterations: steps of the solver.
    """

    actuation: Array
    residual: Array
    converged: NDArray[np.bool_]
    limited_by: NDArray[np.uint64]
    iterations: NDArray[np.integer[Any]]
