"""The fit of a `TipMotion`: how axes swing, then the map behind it, with payloads where they are given.

Dead time, frequency and damping are first common to all axes, then each axis may differ by as much as the
data support. For each of them the map follows by ridge regression (variable projection, Golub and Pereyra
1973), towards the statics of the robot's model where there is one. Degree and penalty are those that predict
left-out fifths of the fitted blocks of time best. Every fifth block is kept out of all of it and judges once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_identify.ahead import PredictedTips, judged_ahead, memory_of, predicted_tips, step_of
from contid_identify.answer import CommandedTrace
from contid_identify.estimate import estimate
from contid_identify.remembered import RememberedMotion, remember
from contid_identify.sections.bent import ArmSections, BentSections
from contid_identify.sections.fit import LoadedInputs, fit_by_folds, start_of, tips_of
from contid_identify.split import Mask, split_time
from contid_identify.tip_answer import LEAST_TIPS
from contid_identify.tip_motion import SwingHalves, TipMotion, clamped, features, swung

#: Tips ``(rows, 3)`` [m] of commands ``(rows, axes)`` at rest, by a model; None where it has none.
Statics: TypeAlias = Callable[[Array], Array]

#: Which samples of each recording.
Rows: TypeAlias = Sequence[NDArray[np.intp]]

#: Share of the variance of the commands below which a combination of axes counts as not moved.
_STILL: Final = 1e-4
#: Starts of the search: dead times [s], frequencies [Hz], damping ratio.
_DELAYS_S: Final = (0.02, 0.08, 0.2, 0.4)
_SWINGS_HZ: Final = (1.0, 2.5, 6.0)
_RATIO: Final = 0.6
_LOW: Final = (0.0, np.log(0.2), np.log(0.02))
_HIGH: Final = (2.0, np.log(30.0), np.log(3.0))
#: Bounds of softening and saturation, per `_LOAD_KG`.
_LOADS: Final = ((-1.0, 0.0), (1.0, 2.0))
#: How far an axis may be from the others: dead time [s], logarithms of frequency and ratio.
_APART: Final = (0.03, 0.3, 0.3)
#: Samples that hold as much as one alone, because errors last.
_ALIKE: Final = 25.0
#: Rows of the search for dead times and swings, and of the map, at most.
_SEARCH_ROWS: Final = 1500
_MAP_ROWS: Final = 6000
#: Penalties per row, of inputs that have a spread of a half.
_PENALTIES: Final = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3)
_MIDDLE: Final = 3e-3
_FOLDS: Final = 5
_DEGREES: Final = (3, 2, 1)
#: The jackknife does not fit the map anew without each block. By this factor intervals of known plants
#: hold the truth as often as stated (`test_intervals_hold_the_truth`).
_MAP_TOO: Final = 1.6
#: Unit of payloads inside a fit, so that their weights are about as large as the others [kg].
_LOAD_KG: Final = 0.1


@dataclass(frozen=True, eq=False)
class LoadedTrace:
    """Commands ``(ticks, axes)`` and measured tips ``(samples, 3)`` [m] under one payload."""

    trace: CommandedTrace
    load_kg: float = 0.0


def fit_tip_motion(
    robot: str, axes: Sequence[str], traces: Sequence[LoadedTrace], statics: Statics | None, source: str,
    sections: ArmSections | None = None,
) -> TipMotion:  # fmt: skip
    """The tip in motion from recordings.

    Args:
        robot: its name.
        axes: names of its axes.
        traces: commands and tips.
        statics: tips at rest, towards which monomials are fitted; not used with sections.
        source: recordings and date.
        sections: of an arm whose bends are to be fitted first; the monomials correct them.

    Raises:
        ContidError: too few tips, no axis moved, or nothing is kept out.
    """
    count = sum(len(each.trace.at_s) for each in traces)
    if count < LEAST_TIPS:
        raise ContidError(f"{count} measured tips; at least {LEAST_TIPS} are needed: record with a tracker")
    fit = _Fit(traces, None if sections is not None else statics)
    shared = fit.searched()
    own = fit.refined(shared)
    degree, penalty = fit.chosen(own)
    own, halves = fit.settled(own, degree, penalty)
    if sections is not None:
        fit.bend(own, sections)
        degree, penalty = fit.chosen(own)
    names, loads = tuple(axes), [each.load_kg for each in traces]

    def numbers() -> TipMotion:
        delay_s, log_hz, log_ratio = fit.of_axes(own)
        weights, load_weights = fit.map_of(own, degree, penalty)
        found = TipMotion(
            robot, names, delay_s, np.exp(log_hz), np.exp(log_ratio), fit.softer(own), fit.less(own),
            fit.centre, fit.turns, *fit.range_of(own), degree, weights, load_weights,
            (min(loads), max(loads)), np.zeros(1), (), source, halves, bent=fit.bent,
        )  # fmt: skip
        return replace(found, remembered=fit.remembered(found))

    step_s = step_of([each.trace.at_s for each in traces])
    memory = memory_of(fit.left_out(own, degree, penalty, step_s), step_s)
    found = replace(numbers(), memory=memory, memory_step_s=step_s)
    kept: list[tuple[PredictedTips, Mask]] = []
    for each in traces:
        trace = each.trace
        tips = predicted_tips(found, trace.sent, trace.period_s, trace.at_s, trace.measured, each.load_kg)
        kept.append((tips, tips.inside & split_time(trace.at_s).kept_out_at(tips.at_s)))
    errors = judged_ahead(found, kept)
    # What judged is no longer kept out of the map: it is as good as the rest.
    fit.take_all()
    if sections is not None:
        fit.bend(own, sections)
    return replace(numbers(), memory=memory, memory_step_s=step_s, errors=errors)


class _Settled(NamedTuple):
    """Parameters of a fit, and how sure those of all axes together are."""

    parameters: Array
    halves: SwingHalves


class _Fit:
    """Fits of the same traces. Parameters: three per axis in turn, then softening and saturation by loads."""

    def __init__(self, traces: Sequence[LoadedTrace], statics: Statics | None) -> None:
        self.loads = [each.load_kg for each in traces]
        self.loaded = np.ptp(self.loads) > 0.0
        # Two payloads show a slope, three its change.
        self.of_loads = min(len(set(self.loads)), 3) - 1
        sent = np.concatenate([each.trace.sent for each in traces])
        self.axes = sent.shape[1]
        self.centre = sent.mean(axis=0)
        _, sizes, turns = np.linalg.svd(sent - self.centre, full_matrices=False)
        moved = sizes**2 > _STILL * max(float((sizes**2).sum()), 1e-300)
        if not moved.any() or sizes[0] <= 0.0:
            raise ContidError(
                "no axis was commanded to move; `contid excite` makes a trajectory that moves it"
            )
        # Inputs with a spread of a half.
        self.turns = turns[moved] / (2.0 * ((sent - self.centre) @ turns[moved].T).std(axis=0))[:, None]
        self.back = np.linalg.pinv(self.turns)
        self.statics = statics
        self.traces = [each.trace for each in traces]
        self.splits = [split_time(each.at_s) for each in self.traces]
        self.search = self._rows(_SEARCH_ROWS)
        self.rows = self._rows(_MAP_ROWS)
        #: Bends of the sections, by all rows and by those without each fold.
        self.bent: BentSections | None = None
        self.bent_without: Sequence[BentSections] = ()

    def _rows(self, most: int) -> Rows:
        fitted = sum(int(each.fitted.sum()) for each in self.splits)
        thin = max(fitted // most, 1)
        return [np.flatnonzero(each.fitted)[::thin] for each in self.splits]

    def take_all(self) -> None:
        """From now on the map is fitted to the blocks too that were kept out."""
        thin = max(sum(len(each.blocks) for each in self.splits) // _MAP_ROWS, 1)
        self.rows = [np.arange(len(each.blocks))[::thin] for each in self.splits]

    def of_axes(self, parameters: Array) -> tuple[Array, Array, Array]:
        """Dead times, logarithms of frequencies and of ratios, ``(axes,)`` each."""
        own = parameters[: 3 * self.axes].reshape(self.axes, 3)
        return own[:, 0], own[:, 1], own[:, 2]

    def softer(self, parameters: Array) -> float:
        """Of the logarithm of the frequencies, per mass [1/kg]."""
        return float(parameters[3 * self.axes]) / _LOAD_KG if self.loaded else 0.0

    def less(self, parameters: Array) -> float:
        """How much less the next payload does [1/kg]."""
        return float(parameters[3 * self.axes + 1]) / _LOAD_KG if self.of_loads > 1 else 0.0

    def effects(self, parameters: Array) -> list[float]:
        """``s`` of the payload of each recording [kg]."""
        return [load_kg / (1.0 + self.less(parameters) * load_kg) for load_kg in self.loads]

    def inputs(self, parameters: Array, rows: Rows) -> list[Array]:
        """What the map acts on, per recording."""
        delay_s, log_hz, log_ratio = self.of_axes(parameters)
        out = []
        for trace, load_kg, own in zip(self.traces, self.effects(parameters), rows, strict=True):
            hz = np.exp(log_hz - self.softer(parameters) * load_kg)
            x = swung(
                trace.sent, trace.period_s, trace.at_s[own], delay_s, hz, np.exp(log_ratio), self.centre
            )
            out.append(x @ self.turns.T)
        return out

    def range_of(self, parameters: Array) -> tuple[Array, Array]:
        """Least and greatest inputs."""
        x = np.concatenate(self.inputs(parameters, self.rows))
        return x.min(axis=0), x.max(axis=0)

    def columns(self, parameters: Array, rows: Rows, degree: int) -> Array:
        """What the weights act on; behind those without load the same times the load."""
        parts = self.inputs(parameters, rows)
        low, high = np.concatenate(parts).min(axis=0), np.concatenate(parts).max(axis=0)
        out = []
        for x, load_kg in zip(parts, self.effects(parameters), strict=True):
            phi = features(x, low, high, degree)
            out.append(np.column_stack([phi, load_kg / _LOAD_KG * phi]) if self.loaded else phi)
        return np.concatenate(out)

    def measured(self, rows: Rows) -> Array:
        """Tips of rows ``(rows, 3)``."""
        return np.concatenate([trace.measured[own] for trace, own in zip(self.traces, rows, strict=True)])

    def prior(self, parameters: Array, degree: int) -> Array:
        """Weights by the statics of the model; they stand for what the data do not show."""
        low, high = self.range_of(parameters)
        draw = np.random.default_rng(7)
        x = np.concatenate([*self.inputs(parameters, self.search), draw.uniform(low, high, (1000, len(low)))])
        count = features(x[:1], low, high, degree).shape[1] * (2 if self.loaded else 1)
        out = np.zeros((count, 3))
        if self.statics is None:
            return out
        tips = self.statics(x @ self.back.T + self.centre)
        good = np.isfinite(tips).all(axis=1)
        if good.sum() > 0.5 * len(x):
            phi = features(x[good], low, high, degree)
            weights = np.linalg.lstsq(phi, tips[good], rcond=None)[0]
            out[: len(weights)] = weights
        return out

    @staticmethod
    def solved(normal: Array, right: Array, rows: int, penalty: float, prior: Array) -> Array:
        """Weights by ridge regression towards ``prior``, of normal equations; the constant is free."""
        weight = np.full(len(normal), penalty * rows)
        weight[0] = 0.0
        return np.asarray(
            prior + np.linalg.solve(normal + np.diag(weight + 1e-9 * rows), right - normal @ prior)
        )

    def left(self, parameters: Array, penalty: float = _MIDDLE) -> Array:
        """What the map leaves over of the rows of the search ``(rows, 3)``."""
        x = self.columns(parameters, self.search, self.degree_at_most(self.search, 5))
        tips = self.measured(self.search)
        none = np.zeros((x.shape[1], 3))
        return np.asarray(tips - x @ self.solved(x.T @ x, x.T @ tips, len(x), penalty, none))

    def degree_at_most(self, chosen: Rows, least: int) -> int:
        """The highest degree with at least ``least`` rows per monomial."""
        rows = sum(map(len, chosen))
        x = np.zeros((1, len(self.turns)))
        ends = x[0] - 1.0, x[0] + 1.0
        twice = 2 if self.loaded else 1
        return next((d for d in _DEGREES if rows >= least * twice * features(x, *ends, d).shape[1]), 1)

    def searched(self) -> Array:
        """Dead time, frequency and ratio common to all axes."""
        from scipy.optimize import least_squares

        tail = [0.0, 0.1][: self.of_loads]

        def spread(three: Array) -> Array:
            return np.concatenate([np.tile(three[:3], self.axes), three[3:]])

        starts = [
            np.array([delay_s, np.log(hz), np.log(_RATIO), *tail])
            for delay_s in _DELAYS_S
            for hz in _SWINGS_HZ
        ]
        start = min(starts, key=lambda three: float((self.left(spread(three)) ** 2).sum()))
        ends = [*_LOW, *_LOADS[0][: len(tail)]], [*_HIGH, *_LOADS[1][: len(tail)]]
        found = least_squares(
            lambda three: self.left(spread(three)).ravel(), start, bounds=ends,
            x_scale=[0.05, 0.2, 0.2, *[0.1] * len(tail)],
            max_nfev=15, diff_step=1e-3,
        )  # fmt: skip
        return spread(found.x)

    def refined(self, shared: Array) -> Array:
        """Every axis for itself, near the others."""
        from scipy.optimize import least_squares

        apart = np.concatenate([np.tile(_APART, self.axes), [0.3] * self.of_loads])
        ends = [
            np.concatenate([np.tile(each, self.axes), loads[: self.of_loads]])
            for each, loads in zip((_LOW, _HIGH), _LOADS, strict=True)
        ]
        size = float(np.sqrt((self.left(shared) ** 2).mean() * _ALIKE))
        if self.axes == 1 or size <= 0.0:
            return shared
        found = least_squares(
            lambda p: np.concatenate([self.left(p).ravel(), size * (p - shared) / apart]),
            np.clip(shared, ends[0] + 1e-6, ends[1] - 1e-6),
            bounds=ends, x_scale=apart, max_nfev=6, diff_step=1e-3,
        )  # fmt: skip
        return np.asarray(found.x)

    def settled(self, parameters: Array, degree: int, penalty: float) -> _Settled:
        """Dead times, frequencies and ratios, each moved for all axes together, by the penalty of the map.

        The search has a penalty that suits noisy data; it takes some of the swing of others. Where left-out
        folds are not predicted better by the move it is not made, and counts as not known.
        """
        axes = np.zeros((3, len(parameters)))
        for k in range(3):
            axes[k, k : 3 * self.axes : 3] = 1.0
        blocks = np.concatenate(
            [
                1000 * k + split.blocks[own]
                for k, (split, own) in enumerate(zip(self.splits, self.search, strict=True))
            ]
        )
        least = -min(0.05, float(parameters[: 3 * self.axes : 3].min()))
        found = estimate(
            lambda three: self.left(parameters + three @ axes, penalty),
            np.zeros(3), np.array([least - 1e-6, -0.2, -0.3]), np.array([0.05, 0.2, 0.3]), blocks,
        )  # fmt: skip
        half = np.array([_MAP_TOO * found.interval(*row).half for row in np.eye(3)])
        moved = parameters + found.values @ axes
        moved[: 3 * self.axes : 3] = np.maximum(moved[: 3 * self.axes : 3], 0.0)
        before, after = (
            float((self._left_out(each, degree, [penalty])[0] ** 2).sum()) for each in (parameters, moved)
        )
        if after >= before:
            moved, half = parameters, half + np.abs(found.values)
        return _Settled(moved, SwingHalves(*half.tolist()))

    def _fold(self) -> Array:
        """The fold of each row of the map: blocks in turn."""
        return np.concatenate(
            [split.blocks[own] // 2 % _FOLDS for split, own in zip(self.splits, self.rows, strict=True)]
        )

    def _left_out(self, parameters: Array, degree: int, penalties: Sequence[float]) -> list[Array]:
        """Errors of each fold by a map of the others ``(rows, 3)``, per penalty."""
        x, tips, folds = self.columns(parameters, self.rows, degree), self.measured(self.rows), self._fold()
        prior = self.prior(parameters, degree)
        out = [np.zeros_like(tips) for _ in penalties]
        data = self.data(parameters, self.rows) if self.bent_without else None
        normal = x.T @ x
        for fold in range(_FOLDS):
            own = folds == fold
            if own.all() or not own.any():
                continue
            left = tips if data is None else tips - tips_of(self.bent_without[fold], data)
            part, values = x[own], left[own]
            others = normal - part.T @ part, x[~own].T @ left[~own], int((~own).sum())
            for errors, penalty in zip(out, penalties, strict=True):
                errors[own] = values - part @ self.solved(*others, penalty, prior)
        return out

    def data(self, parameters: Array, rows: Rows) -> LoadedInputs:
        """Rows as the fit of bends takes them."""
        inputs, low, high = self.inputs(parameters, rows), *self.range_of(parameters)
        effects = [np.full(len(x), s) for x, s in zip(inputs, self.effects(parameters), strict=True)]
        blocks = [
            1000 * k + split.blocks[own] for k, (split, own) in enumerate(zip(self.splits, rows, strict=True))
        ]
        return LoadedInputs(
            clamped(np.concatenate(inputs), low, high), np.concatenate(effects), self.measured(rows),
            np.concatenate(blocks),
        )  # fmt: skip

    def bend(self, parameters: Array, sections: ArmSections) -> None:
        """Fit the bends of the sections, by all rows and without each fold."""
        data, folds = self.data(parameters, self.rows), self._fold()
        sent = np.concatenate([trace.sent for trace in self.traces])
        start = start_of(sections, self.back, self.centre, 2.0 * sent.std(axis=0))
        most = max(self.effects(parameters)) if self.loaded else 0.0
        self.bent, self.bent_without = fit_by_folds(start, data, folds, most)

    def chosen(self, parameters: Array) -> tuple[int, float]:
        """Degree and penalty that predict left-out fifths of the fitted blocks best."""
        best = (np.inf, 1, _MIDDLE)
        for degree in range(1, self.degree_at_most(self.rows, 20) + 1):
            for penalty, errors in zip(
                _PENALTIES, self._left_out(parameters, degree, _PENALTIES), strict=True
            ):
                best = min(best, (float((errors**2).sum()), degree, penalty))
        return best[1], best[2]

    def left_out(self, parameters: Array, degree: int, penalty: float, step_s: float) -> list[Array]:
        """Errors of left-out folds on steps of the recursion, one array per block without gaps."""
        (errors,) = self._left_out(parameters, degree, [penalty])
        out, place = [], 0
        for trace, split, own in zip(self.traces, self.splits, self.rows, strict=True):
            part, at_s, blocks = errors[place : place + len(own)], trace.at_s[own], split.blocks[own]
            place += len(own)
            for block in np.unique(blocks):
                rows = blocks == block
                steps = np.arange(float(at_s[rows][0]), float(at_s[rows][-1]), step_s)
                out.append(np.column_stack([np.interp(steps, at_s[rows], c) for c in part[rows].T]))
        return out

    def remembered(self, found: TipMotion) -> RememberedMotion | None:
        """What the map leaves over of its rows."""
        states, left, loads = [], [], []
        for trace, load_kg, own in zip(self.traces, self.loads, self.rows, strict=True):
            at_s = trace.at_s[own]
            states.append(found.states(trace.sent, trace.period_s, at_s, load_kg))
            left.append(trace.measured[own] - found.predict(trace.sent, trace.period_s, at_s, load_kg))
            loads.append(np.full(len(own), found.load_share(load_kg)))
        return remember(np.concatenate(states), np.concatenate(left), np.concatenate(loads), self._fold())

    def map_of(self, parameters: Array, degree: int, penalty: float) -> tuple[Array, Array]:
        """Weights ``(monomials, 3)`` without load, and per mass of it [m/kg]."""
        x, tips = self.columns(parameters, self.rows, degree), self.measured(self.rows)
        if self.bent is not None:
            tips = tips - tips_of(self.bent, self.data(parameters, self.rows))
        weights = self.solved(x.T @ x, x.T @ tips, len(x), penalty, self.prior(parameters, degree))
        if not self.loaded:
            return weights, np.zeros_like(weights)
        half = len(weights) // 2
        return weights[:half], weights[half:] / _LOAD_KG
