"""What a model leaves over of the recordings it was fitted to, given back where their commands come again.

    r(z, s) = sum over centres c of (1 + s s_c) k(|z - z_c| / width) w_c,   k(d) = exp(-d^2 / 2)

``z`` is the state of the model now and a while ago, ``s`` the payload as a share. Where commands are others
than those of the recordings, every k is about 0 and nothing is added. Of the widths and penalties that do not
harm left-out blocks of time those are taken that leave least over.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array

#: Centres at most.
MOST: Final = 1000
#: Widths, as shares of the spread of the states times the root of twice their number; penalties.
_WIDTHS: Final = (0.2, 0.3, 0.45)
_PENALTIES: Final = (0.1, 0.5)


@dataclass(frozen=True, eq=False)
class RememberedMotion:
    """One sum.

    Attributes:
        scale: states are multiplied by it, ``(states,)``.
        centres: scaled states ``(centres, states)``.
        loads: payloads of the centres, as shares ``(centres,)``.
        weights: ``(centres, 3)`` [m].
    """

    scale: Array
    centres: Array
    loads: Array
    weights: Array

    def added(self, states: Array, load: float) -> Array:
        """What is added to the tips of states ``(samples, states)``, ``(samples, 3)`` [m]."""
        out = np.zeros((len(states), 3))
        weights = self.weights * (1.0 + load * self.loads)[:, None]
        for part in np.array_split(np.arange(len(states)), max(len(states) // 2000, 1)):
            out[part] = _kernel(states[part] * self.scale, self.centres) @ weights
        return out


def remember(states: Array, left: Array, loads: Array, folds: Array) -> RememberedMotion | None:
    """Fit to what is left over of recordings; None where it would harm.

    Args:
        states: ``(rows, states)``; every few of them become centres, `MOST` at most.
        left: what the model leaves over ``(rows, 3)`` [m].
        loads: payloads as shares, ``(rows,)``.
        folds: of the rows; each is predicted from the others to see whether the sum harms.
    """
    thin = max(-(-len(states) // MOST), 1)
    states, left, loads, folds = states[::thin], left[::thin], loads[::thin], folds[::thin]
    spread = states.std(axis=0)
    spread = np.where(spread > 1e-3 * max(float(spread.max()), 1e-300), spread, np.inf)
    found, least = None, np.inf
    for width in _WIDTHS:
        scale = 1.0 / (width * np.sqrt(2.0 * states.shape[1]) * spread)
        kernel = _kernel(states * scale, states * scale) * (1.0 + np.outer(loads, loads))
        for penalty in _PENALTIES:
            inverse = np.linalg.inv(kernel + penalty * np.eye(len(kernel)))
            weights = inverse @ left
            # Left-out folds in closed form: the inverse of the others follows from that of all.
            apart = 0.0
            for fold in np.unique(folds):
                own = folds == fold
                apart += float((np.linalg.solve(inverse[np.ix_(own, own)], weights[own]) ** 2).sum())
            size = float(((penalty * weights) ** 2).sum())
            if apart < float((left**2).sum()) and size < least:
                found, least = RememberedMotion(scale, states * scale, loads, weights), size
    return found


def _kernel(a: Array, b: Array) -> Array:
    apart = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * a @ b.T
    return np.asarray(np.exp(-0.5 * apart))
