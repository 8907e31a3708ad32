"""What a model leaves over of the recordings it was fitted to, given back where their commands come again.

    r(z, s) = sum over centres c of (1 + s s_c) k(|z - z_c| / width) w_c,   k(d) = exp(-d^2 / 2)

``z`` is the state of the model now and a while ago, ``s`` the payload as a share. Where commands are others
than those of the recordings, every k is about 0 and nothing is added. Of the widths and penalties that do not
harm left-out blocks of time those are taken that leave least over.

The same sum corrects a map of bends (`near_bends`): then ``z`` are bends in radians, the same for all
directions, so that sections count by how far they bend; and of widths and penalties those are taken that
predict left-out blocks best. That is the mean of a Gaussian process behind the map (Rasmussen and Williams
2006, section 2.7).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from contid.kinematics.array import Array

#: Centres at most.
MOST: Final = 1000
#: Widths, as shares of the spread of the states times the root of twice their number; penalties.
_WIDTHS: Final = (0.2, 0.3, 0.45)
_PENALTIES: Final = (0.1, 0.5)
#: Of bends: widths [rad], penalties.
_BENDS_RAD: Final = (0.3, 0.45, 0.7)
_BENDS_PENALTIES: Final = (0.3, 1.0, 3.0)


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
    states, left, loads, folds = _thinned(states, left, loads, folds)
    spread = states.std(axis=0)
    spread = np.where(spread > 1e-3 * max(float(spread.max()), 1e-300), spread, np.inf)
    scales = [1.0 / (width * np.sqrt(2.0 * states.shape[1]) * spread) for width in _WIDTHS]
    none = float((left**2).sum())
    fits = [each for each in _fits(states, left, loads, folds, scales, _PENALTIES) if each.left_out < none]
    return min(fits, key=lambda each: each.left_over).found if fits else None


def near_bends(bends: Array, left: Array, loads: Array, folds: Array) -> RememberedMotion | None:
    """What a map of bends is corrected by; None where it would harm.

    Args:
        bends: ``(rows, 2 sections)`` [rad].
        left: what the map leaves over ``(rows, 3)`` [m].
        loads: payloads as shares, ``(rows,)``.
        folds: of the rows.
    """
    bends, left, loads, folds = _thinned(bends, left, loads, folds)
    scales = [np.full(bends.shape[1], 1.0 / width) for width in _BENDS_RAD]
    fits = _fits(bends, left, loads, folds, scales, _BENDS_PENALTIES)
    best = min(fits, key=lambda each: each.left_out)
    return best.found if best.left_out < float((left**2).sum()) else None


class _Fit(NamedTuple):
    """A sum, and the squares [m^2] of what it leaves over and of the errors of left-out folds."""

    found: RememberedMotion
    left_over: float
    left_out: float


def _thinned(*values: Array) -> Sequence[Array]:
    thin = max(-(-len(values[0]) // MOST), 1)
    return [each[::thin] for each in values]


def _fits(
    states: Array, left: Array, loads: Array, folds: Array,
    scales: Sequence[Array], penalties: Sequence[float],
) -> Iterator[_Fit]:  # fmt: skip
    for scale in scales:
        kernel = _kernel(states * scale, states * scale) * (1.0 + np.outer(loads, loads))
        for penalty in penalties:
            inverse = np.linalg.inv(kernel + penalty * np.eye(len(kernel)))
            weights = inverse @ left
            # Left-out folds in closed form: the inverse of the others follows from that of all.
            apart = 0.0
            for fold in np.unique(folds):
                own = folds == fold
                apart += float((np.linalg.solve(inverse[np.ix_(own, own)], weights[own]) ** 2).sum())
            size = float(((penalty * weights) ** 2).sum())
            yield _Fit(RememberedMotion(scale, states * scale, loads, weights), size, apart)


def _kernel(a: Array, b: Array) -> Array:
    apart = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * a @ b.T
    return np.asarray(np.exp(-0.5 * apart))
