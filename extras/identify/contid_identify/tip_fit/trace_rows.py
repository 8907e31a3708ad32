"""Rows of recordings as a fit of a tip's motion takes them: what the map acts on, and the measured tips."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_identify.answer import CommandedTrace
from contid_identify.sections.play import NO_PLAY, AxisPlay
from contid_identify.split import split_time
from contid_identify.tip_motion import features, swung

#: Tips ``(rows, 3)`` [m] of commands ``(rows, axes)`` at rest, by a model; None where it has none.
Statics: TypeAlias = Callable[[Array], Array]

#: Which samples of each recording.
Rows: TypeAlias = Sequence[NDArray[np.intp]]

#: Share of the variance of the commands below which a combination of axes counts as not moved.
_STILL: Final = 1e-4
#: Rows of the search for dead times and swings, and of the map, at most.
_SEARCH_ROWS: Final = 1500
_MAP_ROWS: Final = 6000
#: Parts of the rows of the map, each of which is left out once, and degrees of its monomials.
FOLDS: Final = 5
_DEGREES: Final = (3, 2, 1)
#: Unit of payloads inside a fit, so that their weights are about as large as the others [kg].
LOAD_KG: Final = 0.1
#: The greatest 1 / m0 that is allowed, per `LOAD_KG`.
STIFFEST: Final = 2.0


@dataclass(frozen=True, eq=False)
class LoadedTrace:
    """Commands ``(ticks, axes)`` and measured tips ``(samples, 3)`` [m] under one payload."""

    trace: CommandedTrace
    load_kg: float = 0.0


class TraceRows:
    """The rows of some recordings.

    Parameters of a fit: three per axis in turn, then softening and saturation by loads, then play (in units
    of `unit`) and friction, or none of these two.
    """

    def __init__(self, traces: Sequence[LoadedTrace], statics: Statics | None) -> None:
        self.loads = [each.load_kg for each in traces]
        self.loaded = np.ptp(self.loads) > 0.0
        # Two payloads show a slope, three its change; with two `stiffen` has it.
        self.of_loads = min(len(set(self.loads)), 3) - 1
        self._stiffer_per_kg = 0.0
        sent = np.concatenate([each.trace.sent for each in traces])
        self.axes = sent.shape[1]
        self.centre = sent.mean(axis=0)
        #: Of plays: twice the spread of the commands.
        self.unit = 2.0 * float(np.sqrt(((sent - self.centre) ** 2).mean()))
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
        self._moved: tuple[AxisPlay, list[Array]] | None = None
        self.search = self._rows(_SEARCH_ROWS)
        self.rows = self._rows(_MAP_ROWS)

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
        return float(parameters[3 * self.axes]) / LOAD_KG if self.loaded else 0.0

    def less(self, parameters: Array) -> float:
        """How much less the next payload does [1/kg]."""
        return float(parameters[3 * self.axes + 1]) / LOAD_KG if self.of_loads > 1 else self._stiffer_per_kg

    def play_of(self, parameters: Array) -> AxisPlay:
        """Play and friction."""
        given = parameters[3 * self.axes + self.of_loads :].tolist()
        return AxisPlay(given[0] * self.unit, given[1]) if given else NO_PLAY

    def _behind(self, play: AxisPlay) -> list[Array]:
        """Commands of every recording about the centre, behind a play."""
        if self._moved is None or self._moved[0] != play:
            self._moved = play, [play.behind(each.sent - self.centre) for each in self.traces]
        return self._moved[1]

    def stiffen(self, parameters: Array, gain: float) -> Array:
        """What two payloads do between them, by the stiffness of a body that carries them.

        A payload m adds to the stiffness k of a body that hangs, and takes from that of one that stands:
        commands move it by k / (k + m c) = 1 / (1 + m / m0), which is 1 - s / m0 with the effect
        s = m / (1 + m / m0). So one number, what the greater payload leaves of the gain, fixes m0.

        Args:
            parameters: of a fit whose effects were the payloads themselves.
            gain: of the tip under the greater payload, as a share of that under the lesser one.

        Returns:
            Parameters of the same frequencies under both payloads.
        """
        (low, high), slope = self.ends_kg(parameters), float(parameters[3 * self.axes])
        # A body that stands falls where 1 / m0 = -1 / m; it is taken to be no nearer than halfway.
        found = (1.0 - gain) / max(gain * high - low, 1e-9)
        self._stiffer_per_kg = float(np.clip(found, -0.5 / high, STIFFEST / LOAD_KG))
        low_s, high_s = self.ends_kg(parameters)
        out = parameters.copy()
        out[3 * self.axes] = slope * (high - low) / (high_s - low_s)
        out[1 : 3 * self.axes : 3] += (out[3 * self.axes] * low_s - slope * low) / LOAD_KG
        return out

    def effects(self, parameters: Array) -> list[float]:
        """``s`` of the payload of each recording [kg]."""
        return [load_kg / (1.0 + self.less(parameters) * load_kg) for load_kg in self.loads]

    def ends_kg(self, parameters: Array) -> tuple[float, float]:
        """Least and greatest ``s``."""
        effects = self.effects(parameters)
        return min(effects), max(effects)

    def inputs(self, parameters: Array, rows: Rows) -> list[Array]:
        """What the map acts on, per recording."""
        delay_s, log_hz, log_ratio = self.of_axes(parameters)
        out = []
        moved = self._behind(self.play_of(parameters))
        for trace, sent, load_kg, own in zip(self.traces, moved, self.effects(parameters), rows, strict=True):
            hz = np.exp(log_hz - self.softer(parameters) * load_kg)
            x = swung(sent, trace.period_s, trace.at_s[own], delay_s, hz, np.exp(log_ratio))
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
            out.append(np.column_stack([phi, load_kg / LOAD_KG * phi]) if self.loaded else phi)
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

    def degree_at_most(self, chosen: Rows, least: int) -> int:
        """The highest degree with at least ``least`` rows per monomial."""
        rows = sum(map(len, chosen))
        x = np.zeros((1, len(self.turns)))
        ends = x[0] - 1.0, x[0] + 1.0
        twice = 2 if self.loaded else 1
        return next((d for d in _DEGREES if rows >= least * twice * features(x, *ends, d).shape[1]), 1)

    def folds(self) -> Array:
        """The fold of each row of the map: blocks in turn."""
        return np.concatenate(
            [split.blocks[own] // 2 % FOLDS for split, own in zip(self.splits, self.rows, strict=True)]
        )
