"""What was identified, as lines to read and as one object."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from contid_identify.chambers.filling import Filling
from contid_identify.chambers.motion import NUMBERS, ChamberMotion
from contid_identify.delay_lag import JudgedStage
from contid_identify.estimate import CONFIDENCE, ErrorSize, Interval
from contid_identify.sections.bent import BentSections
from contid_identify.sections.play import NO_PLAY
from contid_identify.stages import IdentifiedAxis, IdentifiedMotion
from contid_identify.tip_motion import TipMotion

_MS = 1e3
_MM = 1e3


def lines(found: IdentifiedMotion) -> Iterator[str]:
    """The report for a terminal."""
    whole_s = sum(each.duration_s for each in found.recordings)
    names = ", ".join(each.name for each in found.recordings)
    yield f"{found.robot}: {whole_s:.1f} s of {names}; blocks of time, every fifth kept out"
    yield "excitation (best possible 95 % intervals, if errors were white noise)"
    for axis in found.axes:
        yield f"  {axis.name:10} {_excitation(axis)}"
    yield "delay and lag of the axes (95 % intervals; errors: RMSE kept out, and its 95 % interval)"
    for axis in found.axes:
        if axis.answer is None:
            yield f"  {axis.name:10} not identified: {axis.refused}"
            continue
        own = axis.answer
        yield (
            f"  {axis.name:10} delay {_text(own.delay_s, _MS)} ms, lag {_text(own.lag_s, _MS)} ms, "
            f"gain {own.gain.value:.4f} +- {own.gain.half:.1g}"
        )
        for stage in own.stages:
            yield f"  {'':10}   {_stage(stage, 1.0 / axis.per_unit, axis.unit)}"
        if own.filling is not None:
            yield f"  {'':10}   {_filled(own.filling, axis)}"
    yield "delay and lag of the tip"
    if found.tip is None:
        yield f"  not identified: {found.tip_refused}"
    else:
        tip = found.tip
        yield f"  delay {_text(tip.delay_s, _MS)} ms, lag {_text(tip.lag_s, _MS)} ms"
        if tip.frequency_hz is not None and tip.ratio is not None:
            yield f"  swing {_text(tip.frequency_hz)} Hz, damping ratio {_text(tip.ratio)}"
        else:
            yield "  the recordings show no swing of their own: delay and lag hold what the body adds"
        for stage in tip.stages:
            yield f"    {_stage(stage, _MM, 'mm')}"
    for ring in found.ring_downs:
        low, high = ring.range_hz
        pose = ", ".join(
            f"{axis.name} {value / axis.per_unit:.3g}"
            for axis, value in zip(found.axes, ring.command, strict=True)
        )
        yield f"ring-down about {pose} ({ring.decays} decays, noise {_MM * ring.noise_m:.2f} mm)"
        for mode in ring.modes:
            yield f"  {_text(mode.frequency_hz)} Hz, damping ratio {_text(mode.ratio)}"
        if ring.decays > 1:
            yield f"  decay by decay: {low:.4g} to {high:.4g} Hz"
    if found.body is not None:
        body = found.body
        fitted, kept = body.decays
        yield (
            f"body ({fitted} decays fitted, {kept} kept out"
            + ("" if kept else ": its errors are of the fit")
            + ")"
        )
        yield (
            f"  mass {_text(body.mass)} times that of the file, damping {_text(body.damping_s, _MS)} ms, "
            f"delay behind the devices {_text(body.delay_s, _MS)} ms"
        )
        for stage in body.stages:
            yield f"    {_stage(stage, _MM, 'mm')}"


def motion_lines(model: TipMotion | ChamberMotion) -> Iterator[str]:
    """The tip in motion: how its axes answer, and what its predictions are off by on data kept out."""
    apart = isinstance(model, ChamberMotion) and model.apart
    yield from _chambers(model) if isinstance(model, ChamberMotion) else _swings(model)
    yield (
        f"  errors, each of the {apart} recordings predicted by a fit to others"
        if apart
        else "  errors, for commands as recorded and on that day: others are missed by more"
    )
    for each in model.errors:
        name = f"{_MS * each.ahead_s:.0f} ms ahead" if math.isfinite(each.ahead_s) else "commands alone"
        yield (f"  {name:18} kept out {_MM * each.rmse_m:9.4g} mm; 95 % within {_MM * each.radius_m:.4g} mm")


def _chambers(model: ChamberMotion) -> Iterator[str]:
    delay_s, *lags = model.times_s.tolist()
    yield (
        f"tip in motion: arcs of chambers; delay {_MS * delay_s:.0f} ms, filling {lags[0]:.2g} and "
        f"{lags[2]:.2g} s, venting {lags[1]:.2g} and {lags[3]:.2g} s"
    )
    for k, own in enumerate(dict(zip(NUMBERS, row, strict=True)) for row in model.numbers.tolist()):
        yield (
            f"  section {k + 1}: {_MM * own['straight_m']:.1f} mm, {_MM * own['longest_m']:.1f} mm at most; "
            f"one chamber bends it by {math.degrees(own['bends_rad']):.0f} deg and lengthens it by "
            f"{_MM * own['grows_m']:.1f} mm; play +- {_MM * (1.0 - own['elastic']) * own['play_m']:.1f} mm"
        )


def _swings(model: TipMotion) -> Iterator[str]:
    bent = "" if model.bent is None else "bends of the sections and "
    yield f"tip in motion: {bent}monomials of degree {model.degree} behind the swing of each axis"
    for axis, delay_s, hz, ratio in zip(
        model.axes, model.delay_s, model.frequency_hz, model.ratio, strict=True
    ):
        yield f"  {axis:10} delay {_MS * delay_s:.0f} ms, {hz:.3g} Hz, damping ratio {ratio:.2g}"
    if model.play != NO_PLAY:
        yield (
            f"  before the swing a play of +- {model.play.half:.3g} m or Pa, and friction that keeps "
            f"{100.0 * model.play.share:.1f} % of a command when it turns back"
        )
    halves = model.halves
    if math.isfinite(halves.delay_s):
        yield (
            f"  all together: delay +- {_MS * halves.delay_s:.1f} ms, frequency +- "
            f"{100.0 * halves.frequency:.1f} %, damping ratio +- {100.0 * halves.ratio:.0f} %"
        )
    else:
        yield "  all together: these recordings do not fix delay, frequency and damping ratio"
    if model.bent is not None:
        yield from _braced(model.bent)


def _braced(bent: BentSections) -> Iterator[str]:
    """What sections brace of one another, where it is known."""
    known = np.argwhere(np.abs(bent.braced) > bent.braced_halves).tolist()
    for i, j, k in known:
        yield (
            f"  section {i + 1} bends by {bent.braced[i, j, k]:+.2f} +- {bent.braced_halves[i, j, k]:.2f} of "
            f"what section {k + 1} would if free less per rad of section {j + 1}"
        )
    if not known:
        yield "  bracing: these recordings do not show that bent sections brace others"


def numbers(found: IdentifiedMotion) -> dict[str, object]:
    """The report for ``--json``; times in s, errors of axes in their unit, of tips in mm."""
    out: dict[str, object] = {
        "robot": found.robot,
        "recordings": [each.name for each in found.recordings],
        "confidence": CONFIDENCE,
        "axes": [_axis(axis) for axis in found.axes],
    }
    if found.tip is not None:
        tip = found.tip
        out["tip"] = {
            "delay_s": _pair(tip.delay_s),
            "lag_s": _pair(tip.lag_s),
            "frequency_hz": None if tip.frequency_hz is None else _pair(tip.frequency_hz),
            "damping_ratio": None if tip.ratio is None else _pair(tip.ratio),
            "stages": [_judged(stage, _MM) for stage in tip.stages],
        }
    out["ring_downs"] = [
        {
            "command": [value / axis.per_unit for axis, value in zip(found.axes, ring.command, strict=True)],
            "decays": ring.decays,
            "noise_mm": _MM * ring.noise_m,
            "modes": [
                {"frequency_hz": _pair(mode.frequency_hz), "damping_ratio": _pair(mode.ratio)}
                for mode in ring.modes
            ],
            "range_hz": list(ring.range_hz),
        }
        for ring in found.ring_downs
    ]
    if found.body is not None:
        out["body"] = {
            "mass_factor": _pair(found.body.mass),
            "damping_s": _pair(found.body.damping_s),
            "delay_s": _pair(found.body.delay_s),
            "decays": list(found.body.decays),
            "stages": [_judged(stage, _MM) for stage in found.body.stages],
        }
    return out


def _axis(axis: IdentifiedAxis) -> dict[str, object]:
    out: dict[str, object] = {
        "name": axis.name,
        "unit": axis.unit,
        "warnings": list(axis.excitation.warnings),
    }
    if axis.answer is None:
        return {**out, "refused": axis.refused}
    own = axis.answer
    return {
        **out,
        "delay_s": _pair(own.delay_s),
        "lag_s": _pair(own.lag_s),
        "sum_s": _pair(own.sum_s),
        "gain": _pair(own.gain),
        "filling": None
        if own.filling is None
        else {
            "delay_s": _pair(own.filling.delay_s),
            "fill_lag_s": _pair(own.filling.fill_lag_s),
            "vent_lag_s": _pair(own.filling.vent_lag_s),
            "fill_per_s": _pair(own.filling.fill_per_s, 1.0 / axis.per_unit),
            "vent_per_s": _pair(own.filling.vent_per_s, 1.0 / axis.per_unit),
        },
        "stages": [_judged(stage, 1.0 / axis.per_unit) for stage in own.stages],
    }


def _filled(of: Filling, axis: IdentifiedAxis) -> str:
    per_unit = 1.0 / axis.per_unit
    return (
        f"fills with {_text(of.fill_lag_s, _MS)} ms, at most {_text(of.fill_per_s, per_unit)} {axis.unit}/s; "
        f"vents with {_text(of.vent_lag_s, _MS)} ms, at most {_text(of.vent_per_s, per_unit)} {axis.unit}/s; "
        f"delay {_text(of.delay_s, _MS)} ms"
    )


def _pair(of: Interval, factor: float = 1.0) -> dict[str, float | None]:
    known = math.isfinite(of.half)
    return {
        "value": factor * of.value,
        "low": factor * of.low if known else None,
        "high": factor * of.high if known else None,
    }


def _judged(stage: JudgedStage, factor: float) -> dict[str, object]:
    return {
        "name": stage.name,
        "fitted_rmse": factor * stage.fitted.rmse,
        "kept_out_rmse": factor * stage.kept_out.rmse,
        "kept_out_95": [factor * stage.kept_out.low, factor * stage.kept_out.high],
    }


def _stage(stage: JudgedStage, factor: float, unit: str) -> str:
    kept: ErrorSize = stage.kept_out
    return (
        f"{stage.name:18} {factor * stage.fitted.rmse:9.4g}   kept out {factor * kept.rmse:9.4g} "
        f"({factor * kept.low:.3g} to {factor * kept.high:.3g}) {unit}"
    )


def _text(of: Interval, factor: float = 1.0) -> str:
    if not math.isfinite(of.half):
        return f"{factor * of.value:.3g} (not fixed by these data)"
    # None of these can be negative.
    return f"{factor * of.value:.4g} ({factor * max(of.low, 0.0):.4g} to {factor * of.high:.4g})"


def _excitation(axis: IdentifiedAxis) -> str:
    shown = axis.excitation
    if not shown.informative:
        return axis.refused
    line = (
        f"{shown.span / axis.per_unit:.3g} {axis.unit}, 95 % of the speed below {shown.upper_hz:.2g} Hz: "
        f"delay to {_MS * shown.delay_s:.1g} ms, lag to {_MS * shown.lag_s:.1g} ms"
    )
    return "; ".join([line, *shown.warnings])
