"""The fit of a `ChamberMotion` to recordings of its tip, by output error.

The numbers begin with the lengths of the robot file and with what silicone arms have; they stay near where
recordings leave a choice. Errors are those of recordings left out as a whole; of one recording alone every
fifth of 30 blocks of time is kept out (`contid_identify.chambers.judged`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.batch import forward_many
from contid.kinematics.model import build_model
from contid.robot_file.cosserat import Cosserat
from contid.units import MM_PER_M
from contid_identify.answer import CommandedTrace, between
from contid_identify.chambers.judged import can_be_apart, judged_apart, judged_by_blocks
from contid_identify.chambers.motion import NUMBERS, Beginning, ChamberArm, ChamberMotion
from contid_identify.remembered import RememberedMotion, remember
from contid_identify.split import Mask, split_time
from contid_identify.tip_answer import LEAST_TIPS

#: Dead time, filling and venting of both stages [s]: start and ends.
_TIMES: Final = np.log([0.2, 0.5, 2.0, 0.4, 0.8])
_LEAST: Final = np.log([0.01, 0.02, 0.02, 0.02, 0.02])
_MOST: Final = np.log([1.0, 4.0, 10.0, 4.0, 10.0])
#: Of a section: start, ends and spread, the first three and the play as shares of its length at rest.
_START: Final = np.array([1.0, 0.2, 1.4, 1.0, 0.45, 0.12, 0.4, 0.55, 0.0])
_SPREAD: Final = np.array([0.06, 0.1, 0.15, 0.6, 0.2, 0.08, 0.15, 0.3, 0.3])
_LOW: Final = np.array([0.6, 0.01, 1.02, 0.0, 0.02, 0.003, 0.05, 0.02, -2.0])
_HIGH: Final = np.array([1.4, 1.5, 3.0, 4.0, 0.98, 0.6, 2.0, 3.0, 2.0])
_LENGTHS: Final = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
#: Pressure of one chamber alone, as a share of its greatest, that shows where it bends the arm.
_ALONE: Final = 0.2
#: Folds of blocks of time, which show whether what is remembered harms.
_FOLDS: Final = 5
#: Tips of the search per recording at most, and what a deviation of one spread weighs [m].
_ROWS: Final = 160
_WEIGHT_M: Final = 3e-3


def arm_of(robot: Cosserat, azimuths_rad: Sequence[float | None] = ()) -> ChamberArm:
    """Sections and chambers of a robot file.

    Args:
        robot: its description.
        azimuths_rad: to which side each chamber bends its section, from +x to +y of the base frame; None for
            those that only lengthen it. Empty: the sides of the statics of the file.

    Raises:
        ContidError: not as many azimuths as chambers.
    """
    count = len(robot.axis_names)
    if azimuths_rad and len(azimuths_rad) != count:
        raise ContidError(
            f"{len(azimuths_rad)} azimuths for {count} chambers; give one each of "
            f"{', '.join(robot.axis_names)}"
        )
    tips = forward_many(build_model(robot), np.diag(_ALONE * np.array(robot.upper)))["tip_m"][:, :2]
    section = np.repeat(np.arange(count // 3), 3)
    lengths = [each.length_mm / MM_PER_M for each in robot.geometry.sections]
    links = [each.link_mm / MM_PER_M for each in robot.geometry.sections]
    directions = tips / np.linalg.norm(tips, axis=1)[:, None]
    if azimuths_rad:
        directions = np.array(
            [(0.0, 0.0) if each is None else (math.cos(each), math.sin(each)) for each in azimuths_rad]
        )
    return ChamberArm(section, directions, np.array(lengths), np.array(links))


def fit_chamber_motion(
    robot: str, axes: Sequence[str], arm: ChamberArm, traces: Sequence[CommandedTrace], source: str,
    kept_out: bool = True,
) -> ChamberMotion:  # fmt: skip
    """The arm in motion from recordings.

    Args:
        robot: its name.
        axes: names of its chambers.
        arm: sections and chambers.
        traces: set-points ``(ticks, axes)`` [Pa] and tips ``(samples, 3)`` [m] in the base frame.
        source: recordings and date.
        kept_out: False keeps nothing out; then the errors are those of the fit.

    Raises:
        ContidError: too few tips, or no chamber was inflated.
    """
    from scipy.optimize import least_squares

    count = sum(len(each.at_s) for each in traces)
    if count < LEAST_TIPS:
        raise ContidError(f"{count} measured tips; at least {LEAST_TIPS} are needed: record with a tracker")
    rest = min(float(each.sent.min()) for each in traces)
    span = max(float(each.sent.max()) for each in traces) - rest
    if span <= 0.0:
        raise ContidError("no chamber was inflated; `contid excite` makes a trajectory that does it")
    scale = np.where(_LENGTHS[:, None] > 0.0, arm.length_m, 1.0).T.ravel()
    start = np.concatenate([_TIMES, np.tile(_START, arm.sections) * scale])
    ends = (
        np.concatenate([least, np.tile(own, arm.sections) * scale])
        for least, own in ((_LEAST, _LOW), (_MOST, _HIGH))
    )
    spread = np.concatenate([np.full(5, 0.7), np.tile(_SPREAD, arm.sections) * scale])
    none = Beginning(np.zeros((arm.sections, 2)), 0.0, np.zeros(3))
    empty = ChamberMotion(
        robot, tuple(axes), arm, rest, span, np.exp(_TIMES), np.zeros((arm.sections, len(NUMBERS))), none,
        np.ones(len(axes)), np.zeros(1), (), source,
    )  # fmt: skip
    apart = kept_out and can_be_apart(traces)
    splits = [split_time(each.at_s) for each in traces]
    fitted = [
        each.fitted if kept_out and not apart else np.ones(len(each.blocks), dtype=bool) for each in splits
    ]
    parts = [
        (trace, np.flatnonzero(own)[:: max(int(own.sum()) // _ROWS, 1)])
        for trace, own in zip(traces, fitted, strict=True)
    ]
    inflated: dict[bytes, list[Array]] = {}

    def model_of(values: Array) -> ChamberMotion:
        return replace(empty, times_s=np.exp(values[:5]), numbers=values[5:].reshape(arm.sections, -1))

    def left(values: Array) -> Array:
        model = model_of(values)
        key = values[:5].tobytes()
        if key not in inflated:
            inflated.clear()
            inflated[key] = [model.inflated(t.sent, t.period_s, float(t.at_s[-1])) for t in traces]
        out = [_WEIGHT_M * (values - start) / spread]
        for (trace, rows), x in zip(parts, inflated[key], strict=True):
            tips = model.tips(x, model.beginning(x[:1], _first(trace)))
            found = between(tips, trace.at_s[rows] / model.step_of(trace.period_s))
            out.append((trace.measured[rows] - found).ravel())
        return np.concatenate(out)

    found = least_squares(
        left, start, bounds=tuple(ends), x_scale=spread, max_nfev=10, diff_step=1e-3, loss="linear"
    )
    model = model_of(found.x)
    begun = [model.zeroed(t.sent, t.period_s, t.at_s, t.measured).begins for t in traces]
    mean = Beginning(
        np.mean([each.bends for each in begun], axis=0),
        float(np.mean([each.share for each in begun])),
        np.mean([each.offset_m for each in begun], axis=0),
    )
    inflations = [model.inflated(t.sent, t.period_s, float(t.at_s[-1])).max(axis=0) for t in traces]
    model = replace(model, begins=mean, high=np.max(inflations, axis=0))
    model = replace(model, remembered=_remembered(model, traces, fitted))
    if not apart:
        return judged_by_blocks(model, traces, kept_out)

    def fitted_to(others: Sequence[CommandedTrace]) -> ChamberMotion:
        return fit_chamber_motion(robot, axes, arm, others, source, kept_out=False)

    return judged_apart(model, traces, fitted_to)


def _remembered(
    model: ChamberMotion, traces: Sequence[CommandedTrace], fitted: Sequence[Mask]
) -> RememberedMotion | None:
    """What the arcs leave over of the fitted tips."""
    states, left, folds = [], [], []
    for trace, own in zip(traces, fitted, strict=True):
        found = model.zeroed(trace.sent, trace.period_s, trace.at_s, trace.measured)
        tips = found.predict(trace.sent, trace.period_s, trace.at_s)
        x = found.inflated(trace.sent, trace.period_s, float(trace.at_s[-1]))
        rows = trace.at_s / model.step_of(trace.period_s)
        states.append(between(model.states(x, trace.period_s), rows)[own])
        left.append((trace.measured - tips)[own])
        folds.append(split_time(trace.at_s).blocks[own] // 2 % _FOLDS)
    of_all = np.concatenate(states)
    return remember(of_all, np.concatenate(left), np.zeros(len(of_all)), np.concatenate(folds))


def _first(trace: CommandedTrace) -> Array:
    from contid_identify.chambers.motion import ZERO_S

    return np.asarray(trace.measured[trace.at_s <= trace.at_s[0] + ZERO_S].mean(axis=0))
