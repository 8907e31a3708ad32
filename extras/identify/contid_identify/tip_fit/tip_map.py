"""The map of a tip's motion: bends of sections if they are fitted, then monomials by ridge regression."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.units import MM_PER_M
from contid_identify.remembered import near_bends, remember
from contid_identify.sections.bent import ArmSections, BentSections
from contid_identify.sections.fit import LoadedInputs, fit_by_folds, start_of, tips_of
from contid_identify.tip_fit.trace_rows import FOLDS, LOAD_KG, Rows, TraceRows
from contid_identify.tip_motion import TipMotion, clamped

#: Penalties per row, of inputs that have a spread of a half.
_PENALTIES: Final = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3)
MIDDLE: Final = 3e-3


def ridge(normal: Array, right: Array, rows: int, penalty: float, prior: Array) -> Array:
    """Weights by ridge regression towards ``prior``, of normal equations; the constant is free."""
    weight = np.full(len(normal), penalty * rows)
    weight[0] = 0.0
    return np.asarray(prior + np.linalg.solve(normal + np.diag(weight + 1e-9 * rows), right - normal @ prior))


class TipMap:
    """Maps of the same rows."""

    def __init__(self, given: TraceRows) -> None:
        self._given = given
        #: Bends of the sections, by all rows and by those without each fold.
        self.bent: BentSections | None = None
        self.bent_without: Sequence[BentSections] = ()

    def _fold_errors(self, parameters: Array, degree: int, penalties: Sequence[float]) -> list[Array]:
        """Errors of each fold by a map of the others ``(rows, 3)``, per penalty."""
        given = self._given
        x, tips = given.columns(parameters, given.rows, degree), given.measured(given.rows)
        folds = given.folds()
        prior = self._given.prior(parameters, degree)
        out = [np.zeros_like(tips) for _ in penalties]
        data = self.data(parameters, self._given.rows) if self.bent_without else None
        normal = x.T @ x
        for fold in range(FOLDS):
            own = folds == fold
            if own.all() or not own.any():
                continue
            left = tips if data is None else tips - tips_of(self.bent_without[fold], data)
            part, values = x[own], left[own]
            others = normal - part.T @ part, x[~own].T @ left[~own], int((~own).sum())
            for errors, penalty in zip(out, penalties, strict=True):
                errors[own] = values - part @ ridge(*others, penalty, prior)
        return out

    def left_out_squared(self, parameters: Array, degree: int, penalty: float) -> float:
        """Sum of the squared errors of left-out folds [m^2]."""
        return float(self.left_out_by_block(parameters, degree, penalty).sum())

    def left_out_by_block(self, parameters: Array, degree: int, penalty: float) -> Array:
        """The same of each block of time ``(blocks,)`` [m^2]."""
        (errors,) = self._fold_errors(parameters, degree, [penalty])
        _, number = np.unique(self._blocks(self._given.rows), return_inverse=True)
        return np.bincount(number, weights=(errors**2).sum(axis=1)).astype(float)

    def _blocks(self, rows: Rows) -> Array:
        return np.concatenate(
            [
                1000 * k + split.blocks[own]
                for k, (split, own) in enumerate(zip(self._given.splits, rows, strict=True))
            ]
        )

    def data(self, parameters: Array, rows: Rows) -> LoadedInputs:
        """Rows as the fit of bends takes them."""
        inputs, low, high = self._given.inputs(parameters, rows), *self._given.range_of(parameters)
        effects = [np.full(len(x), s) for x, s in zip(inputs, self._given.effects(parameters), strict=True)]
        return LoadedInputs(
            clamped(np.concatenate(inputs), low, high), np.concatenate(effects), self._given.measured(rows),
            self._blocks(rows),
        )  # fmt: skip

    def bend(self, parameters: Array, sections: ArmSections) -> None:
        """Fit the bends of the sections, by all rows and without each fold.

        Raises:
            ContidError: bends leave more over than a tip that stands still.
        """
        data, folds = self.data(parameters, self._given.rows), self._given.folds()
        sent = np.concatenate([trace.sent for trace in self._given.traces])
        start = start_of(sections, self._given.back, self._given.centre, 2.0 * sent.std(axis=0))
        most = max(self._given.effects(parameters)) if self._given.loaded else 0.0
        self.bent, self.bent_without = fit_by_folds(start, data, folds, most)
        left = data.tips - tips_of(self.bent, data)
        still = data.tips - data.tips.mean(axis=0)
        left_mm, still_mm = (MM_PER_M * np.sqrt((e**2).sum(axis=1).mean()) for e in (left, still))
        if left_mm > still_mm:
            raise ContidError(
                f"bends of the sections leave {left_mm:.4g} mm of the measured tips over, a tip that stands "
                f"still {still_mm:.4g} mm: the arm of the robot file is not where they were measured. In the "
                "table of a camera the base stands elsewhere: take its place off, or write "
                "`frame: {origin: rest, at: rest}`; `--form map` needs no place"
            )

    def chosen(self, parameters: Array) -> tuple[int, float]:
        """Degree and penalty that predict left-out fifths of the fitted blocks best."""
        best = (np.inf, 1, MIDDLE)
        for degree in range(1, self._given.degree_at_most(self._given.rows, 20) + 1):
            for penalty, errors in zip(
                _PENALTIES, self._fold_errors(parameters, degree, _PENALTIES), strict=True
            ):
                best = min(best, (float((errors**2).sum()), degree, penalty))
        return best[1], best[2]

    def left_out(self, parameters: Array, degree: int, penalty: float, step_s: float) -> list[Array]:
        """Errors of left-out folds on steps of the recursion, one array per block without gaps."""
        (errors,) = self._fold_errors(parameters, degree, [penalty])
        out, place = [], 0
        for trace, split, own in zip(self._given.traces, self._given.splits, self._given.rows, strict=True):
            part, at_s, blocks = errors[place : place + len(own)], trace.at_s[own], split.blocks[own]
            place += len(own)
            for block in np.unique(blocks):
                rows = blocks == block
                steps = np.arange(float(at_s[rows][0]), float(at_s[rows][-1]), step_s)
                out.append(np.column_stack([np.interp(steps, at_s[rows], c) for c in part[rows].T]))
        return out

    def corrected(self, found: TipMotion) -> TipMotion:
        """The model with what the map leaves over of its rows: by bends nearby, then by what came before."""
        bends, states, loads = [], [], []
        for trace, load_kg, own in zip(self._given.traces, self._given.loads, self._given.rows, strict=True):
            given = trace.sent, trace.period_s, trace.at_s[own], load_kg
            bends.append(found.free_bends(found.inputs(*given)))
            states.append(found.states(*given))
            loads.append(np.full(len(own), found.load_share(load_kg)))
        rows = np.concatenate(loads), self._given.folds()
        # One correction for all payloads takes some of what a payload does for what bends do.
        if found.bent is not None and not self._given.loaded:
            found = replace(found, near=near_bends(np.concatenate(bends), self._left_over(found), *rows))
        return replace(found, remembered=remember(np.concatenate(states), self._left_over(found), *rows))

    def _left_over(self, found: TipMotion) -> Array:
        """Of its rows ``(rows, 3)`` [m]."""
        return np.concatenate(
            [
                trace.measured[own] - found.predict(trace.sent, trace.period_s, trace.at_s[own], load_kg)
                for trace, load_kg, own in zip(
                    self._given.traces, self._given.loads, self._given.rows, strict=True
                )
            ]
        )

    def map_of(self, parameters: Array, degree: int, penalty: float) -> tuple[Array, Array]:
        """Weights ``(monomials, 3)`` without load, and per mass of it [m/kg]."""
        given = self._given
        x, tips = given.columns(parameters, given.rows, degree), given.measured(given.rows)
        if self.bent is not None:
            tips = tips - tips_of(self.bent, self.data(parameters, self._given.rows))
        weights = ridge(x.T @ x, x.T @ tips, len(x), penalty, self._given.prior(parameters, degree))
        if not self._given.loaded:
            return weights, np.zeros_like(weights)
        half = len(weights) // 2
        return weights[:half], weights[half:] / LOAD_KG

    def gain_of_load(self, parameters: Array, degree: int, penalty: float) -> float:
        """How far the rows move the tip under the greatest payload, as a share of that under the least."""
        weights, load_weights = self.map_of(parameters, degree, penalty)
        phi = self._given.columns(parameters, self._given.rows, degree)[:, : len(weights)]
        about = phi - phi.mean(axis=0)
        least, greatest = (about @ (weights + s * load_weights) for s in self._given.ends_kg(parameters))
        return float((least * greatest).sum() / max(float((least**2).sum()), 1e-300))
