"""The fit of a `TipMotion`: how axes swing, then the map behind it, with payloads where they are given.

Dead time, frequency and damping are first common to all axes, then each axis may differ by as much as the
data support (`contid_identify.tip_fit.swings`). All of it is sought again with a play before the swing
(`contid_identify.sections.play`), which stays where left-out blocks are clearly predicted better with it; not
with several payloads, which change the tension that friction follows. For each of them the map follows by
ridge regression (`contid_identify.tip_fit.tip_map`; variable projection, Golub and Pereyra 1973), towards the
statics of the robot's model where there is one. Degree and penalty are those that predict left-out fifths of
the fitted blocks of time best. Every fifth block is kept out of all of it and judges once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_identify.ahead import PredictedTips, judged_ahead, memory_of, predicted_tips, step_of
from contid_identify.sections.bent import ArmSections
from contid_identify.split import Mask, split_time
from contid_identify.tip_answer import LEAST_TIPS
from contid_identify.tip_fit.swings import SwingSearch
from contid_identify.tip_fit.tip_map import TipMap
from contid_identify.tip_fit.trace_rows import LoadedTrace, Statics, TraceRows
from contid_identify.tip_motion import TipMotion


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
    rows = TraceRows(traces, None if sections is not None else statics)
    swings, tip_map = SwingSearch(rows), TipMap(rows)
    shared = swings.searched()
    own = swings.refined(shared)
    degree, penalty = tip_map.chosen(own)
    if not rows.loaded:
        plain = _Chosen(own, degree, penalty)
        own, degree, penalty = _with_play(tip_map, plain, swings.refined(swings.with_play(shared)))
    if rows.of_loads == 1:
        own = rows.stiffen(own, tip_map.gain_of_load(own, degree, penalty))
    own, halves = swings.settled(own, penalty, lambda each: tip_map.left_out_squared(each, degree, penalty))
    if sections is not None:
        tip_map.bend(own, sections)
        degree, penalty = tip_map.chosen(own)
    names, loads = tuple(axes), [each.load_kg for each in traces]

    def numbers() -> TipMotion:
        delay_s, log_hz, log_ratio = rows.of_axes(own)
        weights, load_weights = tip_map.map_of(own, degree, penalty)
        return tip_map.corrected(TipMotion(
            robot, names, delay_s, np.exp(log_hz), np.exp(log_ratio), rows.softer(own), rows.less(own),
            rows.centre, rows.turns, *rows.range_of(own), degree, weights, load_weights,
            (min(loads), max(loads)), np.zeros(1), (), source, halves, bent=tip_map.bent,
            play=rows.play_of(own),
        ))  # fmt: skip

    step_s = step_of([each.trace.at_s for each in traces])
    memory = memory_of(tip_map.left_out(own, degree, penalty, step_s), step_s)
    found = replace(numbers(), memory=memory, memory_step_s=step_s)
    kept: list[tuple[PredictedTips, Mask]] = []
    for each in traces:
        trace = each.trace
        tips = predicted_tips(found, trace.sent, trace.period_s, trace.at_s, trace.measured, each.load_kg)
        kept.append((tips, tips.inside & split_time(trace.at_s).kept_out_at(tips.at_s)))
    errors = judged_ahead(found, kept)
    # What judged is no longer kept out of the map: it is as good as the rest.
    rows.take_all()
    if sections is not None:
        tip_map.bend(own, sections)
    return replace(numbers(), memory=memory, memory_step_s=step_s, errors=errors)


class _Chosen(NamedTuple):
    """Parameters, and the degree and penalty of the map that suit them."""

    parameters: Array
    degree: int
    penalty: float


def _with_play(tip_map: TipMap, plain: _Chosen, with_play: Array) -> _Chosen:
    """Parameters with a play where it predicts left-out blocks better by more than its standard error.

    That is the rule of one standard error (Breiman et al., Classification and Regression Trees, 1984, section
    3.4.3): what noise alone may gain is no reason for two numbers more.
    """
    sticky = _Chosen(with_play, *tip_map.chosen(with_play))
    gained = tip_map.left_out_by_block(*plain) - tip_map.left_out_by_block(*sticky)
    return sticky if gained.sum() > math.sqrt(len(gained)) * gained.std(ddof=1) else plain
