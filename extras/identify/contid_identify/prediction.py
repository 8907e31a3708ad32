"""What predictions of one recording are off by, as lines to read, as one object and as a table of tips."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from contid_identify.ahead import PredictedTips, judged_ahead
from contid_identify.estimate import Interval
from contid_identify.moved_on import HOLDS, Recovery
from contid_identify.tip_motion import AheadError, MovingTip, TipMotion

_MM = 1e3


@dataclass(frozen=True, eq=False)
class JudgedPrediction:
    """Errors of the predictions of one recording.

    Attributes:
        errors: at every time ahead, then from commands alone.
        held: share of the tips within the radii that the model gives, in the same order.
        outside: share of the time in which commands were not in the recordings of the fit.
        holds: whether the robot is as it was identified.
    """

    errors: tuple[AheadError, ...]
    held: tuple[float, ...]
    outside: float
    holds: bool


def predicted(model: MovingTip, tips: PredictedTips, after_s: float = 0.0) -> JudgedPrediction:
    """Judge predictions of a recording from ``after_s`` on."""
    from contid_identify.ahead import ahead

    rows = tips.inside & (tips.at_s >= after_s)
    errors = judged_ahead(model, [(tips, rows)])
    held = []
    for each in model.errors:
        if math.isfinite(each.ahead_s):
            left, known = ahead(model, tips, each.ahead_s)
            left = left[rows & known]
        else:
            left = tips.errors_m[rows]
        held.append(float((np.linalg.norm(left, axis=1) <= each.radius_m).mean()) if len(left) else math.nan)
    holds = errors[-1].rmse_m <= HOLDS * model.open_loop.rmse_m
    return JudgedPrediction(errors, tuple(held), tips.outside, holds)


def lines(
    model: MovingTip, found: JudgedPrediction, payload: Interval | None, recovery: Recovery | None
) -> Iterator[str]:
    """The report for a terminal."""
    can_recover = isinstance(model, TipMotion) and recovery is None
    yield f"{model.robot}, identified from {model.source}"
    if payload is not None:
        yield (
            f"payload {_MM * payload.value:.1f} g ({_MM * payload.low:.1f} to {_MM * payload.high:.1f})"
            if math.isfinite(payload.half)
            else f"payload {_MM * payload.value:.1f} g (not fixed by these data)"
        )
    if recovery is not None:
        shift = recovery.later_s
        gains = ", ".join(
            f"{axis} {each.value:.3f}" for axis, each in zip(model.axes, recovery.gains, strict=True)
        )
        yield f"commands take {_MM * shift.value:+.0f} +- {_MM * shift.half:.0f} ms longer; gains {gains}"
        yield (
            f"errors behind the part that was used: {_MM * recovery.before.rmse_m:.2f} mm before, "
            f"{_MM * recovery.zeroed.rmse_m:.2f} mm with a new zero of the tip, "
            f"{_MM * recovery.after.rmse_m:.2f} mm now"
        )
    yield "tips predicted: RMSE here and at identification, radius of 95 % and the share of tips within it"
    for here, then, held in zip(found.errors, model.errors, found.held, strict=True):
        name = f"{_MM * here.ahead_s:.0f} ms ahead" if math.isfinite(here.ahead_s) else "from commands alone"
        yield (
            f"  {name:20} {_MM * here.rmse_m:7.2f} mm, then {_MM * then.rmse_m:7.2f} mm; "
            f"{_MM * then.radius_m:6.2f} mm hold {100.0 * held:.0f} %"
        )
    if found.outside > 0.0:
        yield (
            f"{100.0 * found.outside:.0f} % of the time its commands are not in the recordings of the "
            "identification; predictions are not trustworthy there"
        )
    yield (
        "the robot is as it was identified"
        if found.holds
        else f"the robot has changed: its errors are more than {HOLDS:g} times those of its identification"
        + ("; try --recover 40, or identify it anew" if can_recover else "; identify it anew")
    )


def numbers(found: JudgedPrediction, payload: Interval | None, recovery: Recovery | None) -> dict[str, Any]:
    """The report for ``--json``; lengths in mm, masses in g."""
    out: dict[str, Any] = {
        "holds": found.holds,
        "outside": found.outside,
        "errors": [
            {
                "ahead_s": each.ahead_s if math.isfinite(each.ahead_s) else None,
                "rmse_mm": _number(_MM * each.rmse_m),
                "radius_mm": _number(_MM * each.radius_m),
                "held": _number(held),
            }
            for each, held in zip(found.errors, found.held, strict=True)
        ],
    }
    if payload is not None:
        known = math.isfinite(payload.half)
        out["payload_g"] = {
            "value": _MM * payload.value,
            "low": _MM * payload.low if known else None,
            "high": _MM * payload.high if known else None,
        }
    if recovery is not None:
        out["recovery"] = {
            "later_s": recovery.later_s.value,
            "gains": [each.value for each in recovery.gains],
            "before_mm": _MM * recovery.before.rmse_m,
            "zeroed_mm": _MM * recovery.zeroed.rmse_m,
            "after_mm": _MM * recovery.after.rmse_m,
        }
    return out


def csv_lines(model: MovingTip, tips: PredictedTips) -> Iterator[str]:
    """Measured and predicted tips [mm] in the base frame, with the radius that holds 95 %."""
    yield "t_s,x_mm,y_mm,z_mm,predicted_x_mm,predicted_y_mm,predicted_z_mm,radius_mm\n"
    radius = _MM * model.open_loop.radius_m
    for at_s, measured, predicted_m in zip(
        tips.at_s.tolist(), _MM * tips.measured_m, _MM * tips.predicted_m, strict=True
    ):
        cells = ",".join(f"{value:.3f}" for value in (*measured, *predicted_m, radius))
        yield f"{at_s:.3f},{cells}\n"


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
