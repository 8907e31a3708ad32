"""Paths of a redundant arm whose axes move without corners, so that they can be led.

The model answers row by row, each time with the pressures that are least; along a path these turn corners
where one of them meets a limit, and jump where another answer is as good. Here all rows are solved together,
for curves of the axes that move the tip along the path, stay in the middle of their range as far as the tip
lets them, and whose lead is within the limits: least squares, in Gauss and Newton's steps, with a row for
every value of the lead that is beyond a limit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from contid_dynamics.lead import shares_of

if TYPE_CHECKING:
    from contid.kinematics.array import Array
    from contid.kinematics.model import Model
    from contid_dynamics.lead import Answer

#: Degree of the curves, and how far their knots are apart [s].
_DEGREE: Final = 5
_KNOTS_S: Final = 0.05
#: Steps of Gauss and Newton at most; a step below the least one, as a share of the range, is the last.
_STEPS: Final = 10
_LEAST_STEP: Final = 1e-4
#: Errors are counted in these units, at every knot: of the tip [m]; of a coefficient from the middle of the
#: range, in half ranges; of its third difference from knot to knot, and of the lead beyond a limit, as
#: shares of the range.
_TIP_M: Final = 1e-3
_MIDDLE: Final = 30.0
_TURN: Final = 0.3
_BEYOND: Final = 0.01
#: The lead stays off the limits by this share of the range.
_OFF: Final = 0.02
#: Slopes of the tip are differences over this share of the range; those of the models cost more.
_SLOPE: Final = 1e-4
#: Greatest change of a coefficient in a step, as a share of the range.
_CHANGE: Final = 0.2


def smoothed(model: Model, tips_m: Array, period_s: float, answer: Answer, first: Array, every: int) -> Array:
    """Axes over time whose tip does a path, at rest at both ends.

    Args:
        model: of the robot; its limits are the range of each axis.
        tips_m: the path at the times of commands, in the base frame, ``(ticks, 3)``.
        period_s: between two commands.
        answer: of the robot, whose lead is to be within the limits.
        first: axes at the first row [m or Pa], ``(axes,)``: the search begins with a robot that stays there.
        every: ticks between two looks at the tip.

    Returns:
        Actuations ``(ticks, axes)`` [m or Pa], after at most `_STEPS` steps.
    """
    from scipy import sparse
    from scipy.interpolate import BSpline
    from scipy.sparse.linalg import spsolve

    ticks, axes = len(tips_m), len(first)
    low, high = np.array(model.lower), np.array(model.upper)
    size, end_s = high - low, (ticks - 1) * period_s
    inner = np.linspace(0.0, end_s, max(4, round(end_s / _KNOTS_S)) + 1)
    gap = inner[1]
    beyond = gap * np.arange(1, _DEGREE + 1)
    knots = np.concatenate((-beyond[::-1], inner, end_s + beyond))
    count = len(knots) - _DEGREE - 1
    # The first five coefficients are one number, and so are the last five: the curve rests there.
    groups = np.clip(np.arange(count) - _DEGREE + 1, 0, count - 2 * _DEGREE + 1)
    joined = sparse.csr_matrix((np.ones(count), (np.arange(count), groups)))
    at = period_s * np.arange(ticks)
    design = BSpline.design_matrix(at, knots, _DEGREE) @ joined
    derivatives = [design]
    for nu in (1, 2, 3):
        curves = BSpline(knots, np.eye(count), _DEGREE).derivative(nu)
        derivatives.append(sparse.csr_matrix(np.where(np.abs(curves(at)) > 0.0, curves(at), 0.0)) @ joined)
    leads = [
        sum(share * each for share, each in zip(shares_of(answer, axis), derivatives, strict=True))
        for axis in range(axes)
    ]
    looks = np.arange(0, ticks, every)
    free = design.shape[1]
    turn = sparse.diags([1.0, -3.0, 3.0, -1.0], [0, 1, 2, 3], shape=(free - 3, free)) / _TURN
    weight = np.sqrt(every * period_s / gap)
    base = [sparse.kron(sparse.eye(axes), sparse.vstack((turn, sparse.eye(free) / (0.5 * _MIDDLE)))).tocsr()]
    # Coefficients of the curves ``(axes, free)``, as shares of the range of each axis.
    shares = np.tile(((first - low) / size)[:, None], (1, free))
    for _ in range(_STEPS):
        rows, values = [*base], []
        for axis in range(axes):
            values += [turn @ shares[axis], (shares[axis] - 0.5) / (0.5 * _MIDDLE)]
        actuations = low + size * (design[looks] @ shares.T)
        off = tips_of(model, actuations) - tips_m[looks]
        slopes = np.empty((len(looks), 3, axes))
        for axis in range(axes):
            moved = actuations.copy()
            moved[:, axis] += _SLOPE * size[axis]
            slopes[:, :, axis] = (tips_of(model, moved) - tips_m[looks] - off) / (_SLOPE * _TIP_M)
        for k in range(3):
            rows.append(
                weight * sparse.hstack([sparse.diags(slopes[:, k, a]) @ design[looks] for a in range(axes)])
            )
            values.append(weight * off[:, k] / _TIP_M)
        for axis, lead in enumerate(leads):
            ahead = lead @ shares[axis]
            over = np.where(ahead > 1.0 - _OFF, ahead - 1.0 + _OFF, np.minimum(ahead - _OFF, 0.0))
            bad = np.flatnonzero(over)[:: max(1, every // 2)]
            if len(bad):
                part = sparse.lil_matrix((len(bad), axes * free))
                part[:, axis * free : (axis + 1) * free] = lead[bad] / _BEYOND
                rows.append(part.tocsr())
                values.append(over[bad] / _BEYOND)
        matrix, value = sparse.vstack(rows).tocsc(), np.concatenate(values)
        change = -spsolve(matrix.T @ matrix, matrix.T @ value).reshape(axes, free)
        greatest = float(np.abs(change).max())
        shares = shares + change * min(1.0, _CHANGE / max(greatest, 1e-12))
        if greatest < _LEAST_STEP:
            break
    return np.asarray(low + size * (design @ shares.T))


def tips_of(model: Model, actuations: Array) -> Array:
    """Tips of a model in its base frame [m], ``(rows, 3)``, by actuations ``(rows, axes)``."""
    return np.array([model.forward(tuple(row)).tip_m for row in actuations.tolist()])
