"""What the predictions of a `ChamberMotion` are off by, on tips that its numbers were not fitted to.

Blocks of time kept out are of the same patterns, mounting and hour as those fitted, and show nothing of
others. With recordings left out as a whole, each predicted by a fit to the others, errors hold between
recordings as well: of other patterns where they are of several, of another day where they are of two.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from contid.kinematics.array import Array
from contid_identify.ahead import PredictedTips, judged_ahead, memory_of, predicted_tips, step_of
from contid_identify.answer import CommandedTrace
from contid_identify.chambers.motion import ChamberMotion
from contid_identify.split import Mask, split_time
from contid_identify.tip_answer import LEAST_TIPS

#: Fits to the other recordings at most; more recordings than that are left out several at a time.
_FITS: Final = 5


def can_be_apart(traces: Sequence[CommandedTrace]) -> bool:
    """True of recordings each of which can be predicted by a fit to the others."""
    return all(
        sum(len(each.at_s) for each in part.others) >= LEAST_TIPS
        and any(np.ptp(each.sent) > 0.0 for each in part.others)
        for part in _left_out(traces)
    )


def judged_apart(
    model: ChamberMotion,
    traces: Sequence[CommandedTrace],
    fitted_to: Callable[[Sequence[CommandedTrace]], ChamberMotion],
) -> ChamberMotion:
    """The model with errors, and their recursion, of recordings left out of a fit to the others.

    Args:
        model: fitted to all of them.
        traces: the recordings.
        fitted_to: the fit to some of them.
    """
    model = replace(model, memory_step_s=step_of([each.at_s for each in traces]))
    judged: list[tuple[PredictedTips, Mask]] = []
    for part in _left_out(traces):
        other = replace(fitted_to(part.others), memory_step_s=model.memory_step_s)
        for trace in part.own:
            tips = predicted_tips(other, trace.sent, trace.period_s, trace.at_s, trace.measured, 0.0)
            judged.append((tips, tips.inside))
    model = replace(model, memory=memory_of([each.errors_m for each, _ in judged], model.memory_step_s))
    return replace(model, errors=judged_ahead(model, judged), apart=len(traces))


def judged_by_blocks(model: ChamberMotion, traces: Sequence[CommandedTrace], kept_out: bool) -> ChamberMotion:
    """The model with the recursion of errors by the fitted blocks, and the errors on those kept out."""
    model = replace(model, memory_step_s=step_of([each.at_s for each in traces]))
    judged: list[tuple[PredictedTips, Mask]] = []
    pasts: list[Array] = []
    for trace in traces:
        tips = predicted_tips(model, trace.sent, trace.period_s, trace.at_s, trace.measured, 0.0)
        out = split_time(trace.at_s).kept_out_at(tips.at_s)
        if not kept_out:
            out = np.ones_like(out)
        judged.append((tips, tips.inside & out))
        ends = np.flatnonzero(np.diff(out)) + 1
        parts = zip(np.split(tips.errors_m, ends), np.split(out, ends), strict=True)
        pasts += [errors for errors, own in parts if not (kept_out and own[0])]
    model = replace(model, memory=memory_of(pasts, model.memory_step_s))
    return replace(model, errors=judged_ahead(model, judged))


class LeftOut(NamedTuple):
    """Some recordings, and the others."""

    own: Sequence[CommandedTrace]
    others: Sequence[CommandedTrace]


def _left_out(traces: Sequence[CommandedTrace]) -> list[LeftOut]:
    """Every recording in one of the parts."""
    groups = np.array_split(np.arange(len(traces)), min(len(traces), _FITS))
    return [
        LeftOut([traces[k] for k in own], [each for k, each in enumerate(traces) if k not in own])
        for own in (group.tolist() for group in groups)
    ]
