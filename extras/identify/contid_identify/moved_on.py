"""What a robot carries, and what has changed in it, from a short recording and a `TipMotion` of before.

Payload: the mass whose predictions leave the least innovations over (`contid_identify.ahead`). What a model
leaves over lasts for about a second, and is larger than what a payload does: the differences from its own
forecast are white, and their least squares are the likelihood of the mass. Recovery: after
tendons were tightened or a robot was mounted again, zero and gain of its axes, the place of its tip and one
dead time are sought anew; swing and map stay. Whether they still hold is judged behind the part used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_identify.ahead import error_ahead, innovations, predicted_tips
from contid_identify.answer import CommandedTrace
from contid_identify.estimate import Interval, estimate
from contid_identify.tip_motion import AheadError, TipMotion

#: Errors may be correlated within a block of this duration; at least this many blocks [s].
_BLOCK_S: Final = 1.0
_LEAST_BLOCKS: Final = 4
#: Payloads beyond those of the recordings are searched this far, as a share of their range.
_BEYOND: Final = 0.5
#: How far zeros (in half spreads of the inputs), gains and the dead time [s] are expected to have moved.
_MOVED: Final = (0.5, 0.2, 0.2)
_TIP_M: Final = 0.02
#: Samples that hold as much as one alone, because errors last.
_ALIKE: Final = 25.0
#: Of a recording this many tips are used at most.
_MOST: Final = 4000
#: Errors this many times those of the identification count as another robot.
HOLDS: Final = 1.5


def payload_of(model: TipMotion, trace: CommandedTrace) -> Interval:
    """Mass on the tip [kg] from commands ``(ticks, axes)`` and measured tips in motion.

    Raises:
        ContidError: a model of one payload only, or too short a recording.
    """
    low, high = model.loads_kg
    if high <= low:
        raise ContidError(
            "the model was identified with one payload only; identify with recordings of two at least, each "
            "with its --load-g"
        )
    _check_long_enough(trace, "payload")
    beyond = _BEYOND * (high - low)
    tips = predicted_tips(model, trace.sent, trace.period_s, trace.at_s, trace.measured, low)

    def left(parameters: Array) -> Array:
        load_kg = float(parameters[0])
        found = model.predict(trace.sent, trace.period_s, tips.at_s, load_kg)
        return innovations(model, tips.measured_m - found, tips.inside)

    starts = np.linspace(low, high, 5)
    start = min(starts, key=lambda load: float((left(np.array([load])) ** 2).sum()))
    ends = np.array([low - beyond]), np.array([high + beyond])
    return estimate(left, np.array([start]), *ends, _blocks(tips.at_s)).interval(1.0)


@dataclass(frozen=True, eq=False)
class Recovery:
    """A model brought up to date.

    Attributes:
        model: the new one.
        later_s: by how much commands take longer now.
        gains: of the axes, of what they were.
        tip_m: by how much the tip stands elsewhere.
        before, zeroed, after: errors behind the part that was used: of the old model, of the old model
            with its mean error over that part taken off, and of the new one.
        holds: whether swing and map still hold.
    """

    model: TipMotion
    later_s: Interval
    gains: tuple[Interval, ...]
    tip_m: Array
    before: AheadError
    zeroed: AheadError
    after: AheadError
    holds: bool


def recover(model: TipMotion, trace: CommandedTrace, used_s: float, load_kg: float = 0.0) -> Recovery:
    """Zero, gains and dead time from the first ``used_s`` of a recording; the rest of it judges.

    Raises:
        ContidError: too short a recording.
    """
    first = trace.picked(trace.at_s < used_s)
    rest = trace.picked(trace.at_s >= used_s)
    if len(rest.at_s) < 0.2 * len(trace.at_s):
        raise ContidError(
            f"{trace.name}: {trace.at_s[-1]:.0f} s; it must go on behind the {used_s:g} s that are used, for "
            "a fifth of its length at least"
        )
    _check_long_enough(first, "recovery")
    first = first.picked(np.arange(0, len(first.at_s), max(len(first.at_s) // _MOST, 1)))
    axes = len(model.axes)
    reach = 1.0 / np.maximum(np.abs(model.turns).max(axis=0), 1e-300)
    size = np.sqrt(_ALIKE) * model.open_loop.rmse_m / np.sqrt(3.0)
    spread = np.concatenate([np.repeat(_MOVED[:2], axes), [_MOVED[2]], [_TIP_M] * 3])

    def moved(parameters: Array) -> TipMotion:
        zero, gain = parameters[:axes] * reach, np.exp(parameters[axes : 2 * axes])
        # x' = gain (u - centre) + zero = gain (u - (centre - zero / gain))
        weights = model.weights.copy()
        weights[0] += parameters[2 * axes + 1 :]
        return replace(
            model, centre=model.centre - zero / gain, turns=model.turns * gain,
            delay_s=np.maximum(model.delay_s + parameters[2 * axes], 0.0), weights=weights,
        )  # fmt: skip

    def left(parameters: Array) -> Array:
        # What is remembered would only cost time here: the changes are the map's.
        found = replace(moved(parameters), remembered=None).predict(
            first.sent, first.period_s, first.at_s, load_kg
        )
        # What is expected of the parameters stands behind the tips, in rows of three.
        expected = np.zeros(-(-len(spread) // 3) * 3)
        expected[: len(spread)] = size * parameters / spread
        return np.concatenate([first.measured - found, expected.reshape(-1, 3)])

    extra = -(-len(spread) // 3)
    blocks = np.append(_blocks(first.at_s), np.full(extra, -1.0))
    start = np.zeros(len(spread))
    later = np.linspace(-0.3, 0.3, 13)
    start[2 * axes] = min(
        later, key=lambda s: float((_without_mean(left(_set(start, 2 * axes, s))[:-extra]) ** 2).sum())
    )
    ends = np.full(len(spread), -np.inf), np.full(len(spread), np.inf)
    found = estimate(left, start, *ends, blocks)
    new = moved(found.values)
    old_first = first.measured - model.predict(first.sent, first.period_s, first.at_s, load_kg)
    old = rest.measured - model.predict(rest.sent, rest.period_s, rest.at_s, load_kg)
    after = error_ahead(
        float("inf"), rest.measured - new.predict(rest.sent, rest.period_s, rest.at_s, load_kg)
    )
    unit = np.eye(len(spread))
    return Recovery(
        new,
        found.interval(*unit[2 * axes]),
        tuple(found.interval(*unit[axes + j]).exponential() for j in range(axes)),
        found.values[2 * axes + 1 :],
        error_ahead(float("inf"), old),
        error_ahead(float("inf"), old - old_first.mean(axis=0)),
        after,
        after.rmse_m <= HOLDS * model.open_loop.rmse_m,
    )


def _set(values: Array, place: int, value: float) -> Array:
    out = values.copy()
    out[place] = value
    return out


def _without_mean(values: Array) -> Array:
    return np.asarray(values - values.mean(axis=0))


def _check_long_enough(trace: CommandedTrace, what: str) -> None:
    if len(np.unique(_blocks(trace.at_s))) < _LEAST_BLOCKS:
        raise ContidError(
            f"{what}: {trace.name} has less than {_LEAST_BLOCKS * _BLOCK_S:g} s of measured tips; "
            "record longer"
        )


def _blocks(at_s: Array) -> Array:
    return np.floor(at_s / _BLOCK_S)
