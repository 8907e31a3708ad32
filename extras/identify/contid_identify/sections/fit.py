"""The fit of `BentSections` to tips: Gauss-Newton, towards the bends of the robot's model.

What the tip does not show of a section stays as the model has it. Bends are linear in all numbers once the
free bends are known, so a step has the columns of a regression behind the slope of the tip by the bends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contid.kinematics.array import Array
from contid.kinematics.tendon.model import TendonModel
from contid_identify.estimate import half_intervals
from contid_identify.sections.bent import ArmSections, BentSections, sizes

_STEPS: Final = 8
#: Rows that are fitted, at most twice as many.
_ROWS: Final = 1500
#: Step of the differences of tips [rad].
_STEP_RAD: Final = 1e-5
#: Expected of gains: a share of the greatest of the model. Of rests [rad], cubes, what braces [1/rad], what
#: a payload softens and sags, per unit of its effect.
_GAIN: Final = 0.05
_REST_RAD: Final = 0.1
_CUBE: Final = 0.1
_BRACED: Final = 0.2
_SOFTER: Final = 0.5
_SAG_RAD: Final = 0.1
#: How many times farther from the model numbers may be expected: which of them is shown by left-out folds.
LOOSE: Final = (1.0, 3.0, 10.0)
#: A deviation by that much weighs as many errors as count as one, of the size that is left: at first and at
#: least [m].
_ALIKE: Final = 25.0
_LEFT_M: Final = 5e-3
_LEAST_M: Final = 5e-5


@dataclass(frozen=True, eq=False)
class LoadedInputs:
    """Samples of the fit.

    Attributes:
        inputs: of the map ``(rows, inputs)``.
        effect_kg: of the payload of each row, ``(rows,)``.
        tips: measured ``(rows, 3)`` [m].
        blocks: number of the block of time of each row, ``(rows,)``.
    """

    inputs: Array
    effect_kg: Array
    tips: Array
    blocks: Array

    def picked(self, rows: NDArray[np.bool_]) -> LoadedInputs:
        """Some of the rows."""
        return LoadedInputs(self.inputs[rows], self.effect_kg[rows], self.tips[rows], self.blocks[rows])


def sections_of(model: TendonModel) -> ArmSections:
    """Sections of a tendon robot, and their bends by its pulls or drives."""
    axes = len(model.axis_names)
    bends = np.column_stack([model.bends(row) for row in np.eye(axes)])
    lengths = np.array([each.length_m for each in model.geometry.sections])
    # A tip aside of the axis is left to the map.
    links = np.append(np.zeros(len(lengths) - 1), model.geometry.tip_offset_m[2])
    return ArmSections(
        lengths, links, bends.reshape(-1, 2, axes), np.zeros((len(lengths), 2)),
        np.array([0.0, 0.0, model.geometry.base_offset_m]), np.eye(3),
    )  # fmt: skip


def start_of(arm: ArmSections, back: Array, centre: Array, spread: Array) -> BentSections:
    """The arm as its model has it.

    Args:
        arm: sections and their bends by commands.
        back: from inputs of the map to commands about the centre, ``(axes, inputs)``.
        centre: commands in the middle, ``(axes,)``.
        spread: of the commands, ``(axes,)``; twice the standard deviation of each.
    """
    count, axes = len(arm.length_m), len(centre)
    gains = (arm.bends_by_axes * spread).transpose(2, 0, 1)
    return BentSections(
        arm.length_m, arm.link_m, arm.base_m, arm.frame, back / spread[:, None], gains, np.zeros(axes),
        arm.rest + arm.bends_by_axes @ centre, np.zeros((count, count, count)), np.zeros((count, count)),
        np.zeros((count, 2)), np.full(axes, np.inf), np.full((count, count, count), np.inf),
    )  # fmt: skip


def fit_bent(
    start: BentSections, data: LoadedInputs, effect_kg: float, loose: float, halves: bool = True
) -> BentSections:
    """The numbers that fit tips best, near those of a start where tips leave a choice.

    Args:
        start: as `start_of` has it.
        data: of the recordings.
        effect_kg: greatest effect of a payload in them; 0: what a payload does is not fitted.
        loose: how many times farther from the start numbers are expected, one of `LOOSE`.
        halves: False leaves intervals out.
    """
    found = start
    prior, spread, left_m = _vector(start), loose * _spread(start, effect_kg), _LEFT_M
    for _ in range(_STEPS):
        slope, left = _slope(found, data)
        weight = _ALIKE * (left_m / spread) ** 2
        left_m = max(min(left_m, float(np.sqrt((left**2).mean()))), _LEAST_M)
        values = _vector(found)
        step = np.linalg.solve(
            slope.T @ slope + np.diag(weight), slope.T @ left.ravel() + weight * (prior - values)
        )
        found = _of(found, values + step)
    if not halves:
        return found
    slope, left = _slope(found, data)
    half = _of(found, half_intervals(slope, left, data.blocks, weight, spread))
    return replace(found, cube_halves=half.cubes, braced_halves=half.braced)


class FittedFolds(NamedTuple):
    """Fits to all rows, and to those without each fold in turn."""

    bent: BentSections
    without: Sequence[BentSections]


def fit_by_folds(start: BentSections, data: LoadedInputs, folds: Array, effect_kg: float) -> FittedFolds:
    """The numbers that fit tips best, as far from the model as left-out folds are predicted best.

    Args:
        start: as `start_of` has it.
        data: of the recordings; every few rows are fitted.
        folds: number of the fold of each row, ``(rows,)``.
        effect_kg: greatest effect of a payload in them.
    """
    thin = np.arange(len(folds)) % max(len(folds) // _ROWS, 1) == 0
    data, folds = data.picked(thin), folds[thin]
    best = (math.inf, LOOSE[0], list[BentSections]())
    for loose in LOOSE:
        without, off = [], 0.0
        for fold in range(int(folds.max()) + 1):
            without.append(fit_bent(start, data.picked(folds != fold), effect_kg, loose, halves=False))
            left = data.tips - tips_of(without[-1], data)
            off += float((left[folds == fold] ** 2).sum())
        best = min(best, (off, loose, without), key=lambda each: each[0])
    return FittedFolds(fit_bent(start, data, effect_kg, best[1]), best[2])


def _vector(of: BentSections) -> Array:
    parts = (of.gains, of.rest, of.cubes, of.braced, of.softer, of.sag)
    return np.concatenate([each.ravel() for each in parts])


def _of(found: BentSections, values: Array) -> BentSections:
    names = ("gains", "rest", "cubes", "braced", "softer", "sag")
    ends = np.cumsum([getattr(found, name).size for name in names])
    parts = np.split(values, ends[:-1])
    return replace(
        found,
        **{name: part.reshape(getattr(found, name).shape) for name, part in zip(names, parts, strict=True)},
    )


def _spread(start: BentSections, effect_kg: float) -> Array:
    """How far from the prior `_vector` is expected."""
    gain = _GAIN * max(float(np.abs(start.gains).max()), 1e-3)
    # Without payloads their numbers are held at nothing.
    loaded = effect_kg if effect_kg > 0.0 else 1e-9
    spreads: Sequence[tuple[int, float]] = (
        (start.gains.size, gain),
        (start.rest.size, _REST_RAD),
        (start.cubes.size, _CUBE),
        (start.braced.size, _BRACED),
        (start.softer.size, _SOFTER / loaded),
        (start.sag.size, _SAG_RAD / loaded),
    )
    spread = np.concatenate([np.full(size, value) for size, value in spreads])
    if effect_kg <= 0.0:
        spread[-start.softer.size - start.sag.size :] = 1e-9
    return spread


def _slope(found: BentSections, data: LoadedInputs) -> tuple[Array, Array]:
    """Slope of tips by `_vector` ``(3 rows, numbers)`` and what they leave over ``(rows, 3)``."""
    y = data.inputs @ found.axes_by_inputs.T
    rows = len(y)
    count = len(found.length_m)
    free = found.free(y)
    size = sizes(free)
    bends = bends_of(found, data)
    tips = found.placed(bends)
    moved = np.empty((rows, 3, count, 2))
    for k in range(count):
        for c in range(2):
            other = bends.copy()
            other[:, k, c] += _STEP_RAD
            moved[:, :, k, c] = (found.placed(other) - tips) / _STEP_RAD
    cubed = y + found.cubes * y**3
    # By the free bends: what braces depends on them as well.
    by_free = -np.einsum("ndic,ijk,nj->ndkc", moved, found.braced, size)
    pulled = np.einsum("ndic,ijk,nkc->ndj", moved, found.braced, free)
    by_free -= np.einsum("ndj,njc->ndjc", pulled, free / size[:, :, None])
    by_free -= np.einsum("n,ndic,ik->ndkc", data.effect_kg, moved, found.softer)
    columns = (
        np.einsum("na,ndkc->ndakc", cubed, moved) + np.einsum("na,ndkc->ndakc", y, by_free),
        moved,
        np.einsum("na,akc,ndkc->nda", y**3, found.gains, moved),
        -np.einsum("ndic,nj,nkc->ndijk", moved, size, free),
        -np.einsum("n,ndic,nkc->ndik", data.effect_kg, moved, free),
        -data.effect_kg[:, None, None, None] * moved,
    )
    slope = np.concatenate([each.reshape(rows, 3, -1) for each in columns], axis=2)
    return slope.reshape(3 * rows, -1), data.tips - tips


def tips_of(found: BentSections, data: LoadedInputs) -> Array:
    """Tips ``(rows, 3)`` [m] of samples, each under its payload."""
    return found.placed(bends_of(found, data))


def bends_of(found: BentSections, data: LoadedInputs) -> Array:
    """Bends ``(rows, sections, 2)`` [rad] of samples, each under its payload."""
    out = np.empty((len(data.inputs), len(found.length_m), 2))
    for effect_kg in np.unique(data.effect_kg):
        own = data.effect_kg == effect_kg
        out[own] = found.bends(data.inputs[own], float(effect_kg))
    return out
