"""Friction of tendons as a play (backlash) operator.

Play of half width r: what arrives follows what is commanded at most r behind,

    delivered' = min(commanded + r, max(commanded - r, delivered)),

the state is the value delivered last (Brokate, Sprekels: Hysteresis and Phase Transitions, 1996, 2.1).
`contid.control.tick.play` leads it, `contid.kinematics.tendon.capstan` the loss of tension in bends.
"""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array


def play(commanded: Array | float, delivered: Array | float, half_width: Array | float) -> Array:
    """What arrives [m] for a command [m], from what arrived last [m]; elementwise."""
    return np.minimum(
        np.add(commanded, half_width), np.maximum(np.subtract(commanded, half_width), delivered)
    )


def play_series(commanded: Array, half_width: Array | float, start: Array | float | None = None) -> Array:
    """What arrives along a recording: commands ``(times, ...)`` [m]; ``start``: what arrived before."""
    commanded = np.asarray(commanded, dtype=np.float64)
    delivered = np.array(commanded[0] if start is None else start, dtype=np.float64)
    out = np.empty_like(commanded)
    for k, row in enumerate(commanded):
        delivered = play(row, delivered, half_width)
        out[k] = delivered
    return out
