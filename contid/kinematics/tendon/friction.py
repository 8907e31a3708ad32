"""Friction of tendons: a play (backlash) operator with its inverse, and the capstan's loss of tension.

Play of half width r: what arrives follows what is commanded at most r behind,

    delivered' = min(commanded + r, max(commanded - r, delivered)),

the state is the value delivered last (Brokate, Sprekels: Hysteresis and Phase Transitions, 1996, 2.1). Its
inverse adds r in the direction of motion. Capstan: a tendon that slides over a total bend theta loses

    tension_far = tension_near exp(-+ mu theta),     - while it is pulled in, + while it is paid out.

Pure functions; the caller keeps the state, so that a replay gives the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array


def play(commanded: Array | float, delivered: Array | float, half_width: Array | float) -> Array:
    """What arrives [m] for a command [m], from what arrived last [m]; elementwise."""
    return np.minimum(
        np.add(commanded, half_width), np.maximum(np.subtract(commanded, half_width), delivered)
    )


def play_inverse(
    required: Array | float, delivered: Array | float, commanded: Array | float, half_width: Array | float
) -> Array:
    """The command [m] after which exactly ``required`` [m] arrives, elementwise.

    Args:
        required: what has to arrive.
        delivered: what arrived last.
        commanded: the last command; kept where ``required`` arrived already, so that at rest nothing moves.
        half_width: r.
    """
    up = np.add(required, half_width)
    down = np.subtract(required, half_width)
    # At rest every command within r of the delivered value keeps it; the last one does, up to rounding.
    still = np.clip(commanded, down, up)
    return np.where(np.greater(required, delivered), up, np.where(np.less(required, delivered), down, still))


def play_series(commanded: Array, half_width: Array | float, start: Array | float | None = None) -> Array:
    """What arrives along a recording: commands ``(times, ...)`` [m]; ``start``: what arrived before."""
    commanded = np.asarray(commanded, dtype=np.float64)
    delivered = np.array(commanded[0] if start is None else start, dtype=np.float64)
    out = np.empty_like(commanded)
    for k, row in enumerate(commanded):
        delivered = play(row, delivered, half_width)
        out[k] = delivered
    return out


def capstan(tension: Array | float, bend_rad: Array | float, mu: float, sliding: Array | float) -> Array:
    """Tension at the far end [N] after a total bend [rad]; ``sliding``: > 0 pulled in, < 0 paid out."""
    return np.multiply(tension, np.exp(-mu * np.sign(sliding) * np.abs(bend_rad)))


@dataclass(frozen=True, slots=True)
class TendonPlay:
    """Play of every tendon of a robot, as the control loop carries it from tick to tick.

    Attributes:
        half_width_m: r of each tendon [m]; 0 switches it off.
        delivered_m: what arrived last [m].
        commanded_m: the last command [m].
    """

    half_width_m: tuple[float, ...]
    delivered_m: tuple[float, ...]
    commanded_m: tuple[float, ...]

    @classmethod
    def at(cls, half_width_m: Sequence[float], position_m: Sequence[float]) -> TendonPlay:
        """In the middle of the play: the device stands at ``position_m`` [m] and so does the tendon."""
        here = tuple(float(value) for value in position_m)
        return cls(tuple(half_width_m), here, here)

    def command(self, required_m: Sequence[float]) -> TendonPlay:
        """The state after the command that delivers ``required_m`` [m]; ``commanded_m`` is that command."""
        required = np.array(required_m)
        last, delivered = np.array(self.commanded_m), np.array(self.delivered_m)
        commanded = play_inverse(required, delivered, last, np.array(self.half_width_m))
        return TendonPlay(self.half_width_m, tuple(required.tolist()), tuple(commanded.tolist()))
