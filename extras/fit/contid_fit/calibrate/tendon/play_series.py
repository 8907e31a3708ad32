"""The play of the drives of a tendon robot along a recording."""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.tendon.capstan import play


def play_series(commanded: Array, half_width: Array | float, start: Array | float | None = None) -> Array:
    """What arrives along a recording: commands ``(times, ...)`` [m]; ``start``: what arrived before."""
    commanded = np.asarray(commanded, dtype=np.float64)
    delivered = np.array(commanded[0] if start is None else start, dtype=np.float64)
    out = np.empty_like(commanded)
    for k, row in enumerate(commanded):
        delivered = play(row, delivered, half_width)
        out[k] = delivered
    return out
