"""A tip in motion as numbers: what a robot does with its commands, for any commands and any payload.

    x_j(t) = command j behind its play, late by its dead time, behind a body of one mode of its own
    tip(t) = bent(clip(x), s) + (w + s v) . monomials(clip(x)),   s = m / (1 + m / m0),   m: payload

The swing is in the axes and the map behind it (Wiener). Monomials are clamped to the range of the recordings
they were fitted to: outside the map stands still and nothing grows with a power of three. Arms of sections
may have their bends in front of the monomials (`contid_identify.sections.bent`). Fitted by
`contid_identify.tip_motion_fit`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Protocol, Self

import numpy as np

from contid.kinematics.array import Array
from contid_identify.answer import checked_commands, smoothly_between
from contid_identify.remembered import RememberedMotion
from contid_identify.sections.bent import BentSections
from contid_identify.sections.play import NO_PLAY, AxisPlay
from contid_identify.tip_answer import monomials, swing

#: Inputs are clamped this share of their range beyond it.
_BEYOND: Final = 0.05
#: Between two errors of the memory of files that do not state it [s].
OLD_STEP_S: Final = 0.02
#: Times before, by whose inputs recordings differ [s].
_AGO_S: Final = (0.0, 0.2, 0.4)
AGES: Final = len(_AGO_S)


@dataclass(frozen=True, slots=True)
class AheadError:
    """What predictions are off by on data kept out of the fit.

    Attributes:
        ahead_s: how long ahead, with measured tips until then; infinite for commands alone.
        rmse_m: root mean square of the distance.
        radius_m: holds 95 % of the tips.
    """

    ahead_s: float
    rmse_m: float
    radius_m: float


@dataclass(frozen=True, slots=True)
class SwingHalves:
    """Half of the 95 % intervals of what axes have in common; infinite where the data do not fix it.

    Attributes:
        delay_s: of all dead times together.
        frequency, ratio: of all frequencies and damping ratios together, as shares of them.
    """

    delay_s: float
    frequency: float
    ratio: float


class MovingTip(Protocol):
    """A model of a tip in motion that `contid predict` compares recordings with."""

    @property
    def robot(self) -> str:
        """Its name."""

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of its axes."""

    @property
    def memory(self) -> Array:
        """Weights ``(order,)`` by which the last errors go on, see `contid_identify.ahead`."""

    @property
    def remembered(self) -> RememberedMotion | None:
        """What is added where commands of the recordings come again."""

    @property
    def memory_step_s(self) -> float:
        """Between two of these errors [s]."""

    @property
    def errors(self) -> tuple[AheadError, ...]:
        """Of predictions on blocks kept out, the longest time ahead last."""

    @property
    def source(self) -> str:
        """Recordings and date."""

    @property
    def open_loop(self) -> AheadError:
        """Errors of predictions from commands alone."""

    def zeroed(self, sent: Array, period_s: float, at_s: Array, tip_m: Array) -> Self:
        """The model as a recording begins, by its first tips."""

    def predict(self, sent: Array, period_s: float, at_s: Array | None = None, load_kg: float = 0.0) -> Array:
        """Tips ``(samples, 3)`` [m] from commands alone."""

    def outside(self, sent: Array, period_s: float, at_s: Array, load_kg: float = 0.0) -> float:
        """Share of the time in which commands were not in the recordings of the fit."""


_NOT_FIXED: Final = SwingHalves(math.inf, math.inf, math.inf)


@dataclass(frozen=True, eq=False)
class TipMotion:
    """The tip of one robot in motion.

    Attributes:
        robot: its name.
        axes: names of its axes.
        delay_s, frequency_hz, ratio: dead time, undamped frequency and damping ratio of each axis.
        softer_per_kg: how much less the logarithm of the frequencies is per ``s`` [1/kg].
        less_per_kg: 1 / m0: a body that hangs is stiffer the more it carries [1/kg].
        centre: commands in the middle of the recordings [m or Pa], ``(axes,)``.
        turns: from commands about the centre to inputs of the map, ``(inputs, axes)``; inputs reach about 1.
        low, high: range of the inputs, ``(inputs,)``.
        degree: of the monomials.
        weights: of a constant and the monomials ``(monomials, 3)`` [m].
        load_weights: the same per ``s`` [m/kg].
        loads_kg: least and greatest payload of the recordings.
        memory: weights by which the last errors, ``memory_step_s`` apart, go on; shape ``(order,)``.
        errors: of predictions on blocks kept out, the longest time last.
        source: recordings and date.
        halves: how sure dead times, frequencies and ratios are.
        remembered: what is added to the map where commands of the recordings come again, or None.
        bent: bends of the sections, which the monomials correct; None: the monomials are all.
        play: of every axis, about ``centre``.
        near: what is added to the map by free bends near those of the recordings, or None.
    """

    robot: str
    axes: tuple[str, ...]
    delay_s: Array
    frequency_hz: Array
    ratio: Array
    softer_per_kg: float
    less_per_kg: float
    centre: Array
    turns: Array
    low: Array
    high: Array
    degree: int
    weights: Array
    load_weights: Array
    loads_kg: tuple[float, float]
    memory: Array
    errors: tuple[AheadError, ...]
    source: str
    halves: SwingHalves = _NOT_FIXED
    remembered: RememberedMotion | None = None
    memory_step_s: float = OLD_STEP_S
    bent: BentSections | None = None
    play: AxisPlay = NO_PLAY
    near: RememberedMotion | None = None

    def predict(self, sent: Array, period_s: float, at_s: Array | None = None, load_kg: float = 0.0) -> Array:
        """Tips ``(samples, 3)`` [m] in the base frame, from commands alone; the robot rests before.

        Args:
            sent: commands, held from tick to tick, ``(ticks, axes)`` [m or Pa].
            period_s: between two of them; the first is at time 0.
            at_s: times of the tips; None for those of the commands.
            load_kg: mass of the payload.

        Raises:
            ContidError: commands of another number of axes, or not finite.
        """
        sent = checked_commands(sent, period_s, self.robot, len(self.axes))
        at_s = np.arange(float(len(sent))) * period_s if at_s is None else at_s
        takes = self.inputs if self.remembered is None else self.states
        states = takes(sent, period_s, at_s, load_kg)
        inputs = states[:, : len(self.low)]
        tips = self.tips(inputs, load_kg)
        if self.near is not None:
            tips += self.near.added(self.free_bends(inputs), self.load_share(load_kg))
        if self.remembered is not None:
            tips += self.remembered.added(states, self.load_share(load_kg))
        return tips

    def states(self, sent: Array, period_s: float, at_s: Array, load_kg: float) -> Array:
        """Inputs of the map now and before, by which recordings are remembered; ``(samples, states)``."""
        at_all_s = np.concatenate([at_s - ago_s for ago_s in _AGO_S])
        return np.hstack(np.split(self.inputs(sent, period_s, at_all_s, load_kg), AGES))

    def free_bends(self, inputs: Array) -> Array:
        """Bends ``(samples, 2 sections)`` [rad] as if sections were free, none without sections."""
        if self.bent is None:
            return np.zeros((len(inputs), 0))
        axes = clamped(inputs, self.low, self.high) @ self.bent.axes_by_inputs.T
        return self.bent.free(axes).reshape(len(inputs), -1)

    def load_share(self, load_kg: float) -> float:
        """A payload as a share of the greatest one of the recordings."""
        return self.effect_kg(load_kg) / self.effect_kg(self.loads_kg[1]) if self.loads_kg[1] > 0.0 else 0.0

    def inputs(self, sent: Array, period_s: float, at_s: Array, load_kg: float) -> Array:
        """What the map acts on at times ``at_s``: ``(samples, inputs)``, not clamped."""
        hz = self.frequency_hz * np.exp(-self.softer_per_kg * self.effect_kg(load_kg))
        moved = self.play.behind(sent - self.centre)
        return swung(moved, period_s, at_s, self.delay_s, hz, self.ratio) @ self.turns.T

    def tips(self, inputs: Array, load_kg: float) -> Array:
        """Tips ``(samples, 3)`` [m] of inputs of the map."""
        effect_kg = self.effect_kg(load_kg)
        weights = self.weights + effect_kg * self.load_weights
        tips = np.asarray(features(inputs, self.low, self.high, self.degree) @ weights)
        if self.bent is not None:
            tips += self.bent.tips(clamped(inputs, self.low, self.high), effect_kg)
        return tips

    def effect_kg(self, load_kg: float) -> float:
        """``s`` of a payload."""
        return load_kg / (1.0 + self.less_per_kg * max(load_kg, 0.0))

    def zeroed(self, sent: Array, period_s: float, at_s: Array, tip_m: Array) -> Self:
        """Itself: what a recording begins with does not change it, see `MovingTip`."""
        return self

    def outside(self, sent: Array, period_s: float, at_s: Array, load_kg: float = 0.0) -> float:
        """Share of the samples whose inputs were not in the recordings of the fit."""
        inputs = self.inputs(sent, period_s, at_s, load_kg)
        beyond = _BEYOND * (self.high - self.low)
        return float(((inputs < self.low - beyond) | (inputs > self.high + beyond)).any(axis=1).mean())

    @property
    def open_loop(self) -> AheadError:
        """Errors of predictions from commands alone."""
        return self.errors[-1]


def clamped(inputs: Array, low: Array, high: Array) -> Array:
    """Inputs ``(samples, inputs)`` within a range and a little beyond."""
    beyond = _BEYOND * (high - low)
    return np.clip(inputs, low - beyond, high + beyond)


def features(inputs: Array, low: Array, high: Array, degree: int) -> Array:
    """A constant and monomials of inputs clamped to a range, ``(samples, monomials)``."""
    within = clamped(inputs, low, high)
    return np.column_stack([np.ones(len(within)), monomials(within, degree)])


def swung(moved: Array, period_s: float, at_s: Array, delay_s: Array, hz: Array, ratio: Array) -> Array:
    """Axes ``(ticks, axes)``, late and behind one mode each, at times ``at_s``; ``(samples, axes)``."""
    out = np.empty((len(at_s), moved.shape[1]))
    for j in range(moved.shape[1]):
        values = swing(moved[:, j : j + 1], period_s, float(hz[j]), float(ratio[j]))
        out[:, j] = smoothly_between(values, (at_s - delay_s[j]) / period_s)[:, 0]
    return out
