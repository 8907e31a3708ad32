"""The tip of a real tendon trunk in motion by `TipMotion`, beside black boxes: open loop, payload, ahead.

``CONTID_SHARED_DATA=.. python -m studies.moving.trunk_motion`` prints the tables.

Recordings: StanfordASL/trunk-stack at commit 8b4b923 (MIT, (c) 2024 Stanford Autonomous Systems Lab),
repacked; 150 s of the same commands with 0, 100 and 300 g. The split, set beforehand:

* other commands: fitted to the first 70 % of the recording with 0 g, predicted are its last 27 %;
* payload, its mass apart: fitted to 0 and 300 g, predicted are all 150 s with 100 g, the same commands; its
  mass is also found from windows of 5 and 10 s. What is between two payloads follows from the gain that
  the greater one leaves;
* payload, commands apart: fitted to the first 70 % with 0, 100 and 300 g, predicted the last 27 % with 100
  and 300 g;
* another day: none is given. In its place the commands of the last 27 % are changed: 180 ms later, gains of
  0.85 to 1.15, zeros by a tenth of the spread. 20 s of them recover the model, the rest judges.

Bends of the sections begin with those of the motor angles of the fitted rows
(`studies.moving.trunk_statics`), on contid's own tendon statics; the map without them begins with the same
statics. Degree and penalty of the map are chosen by folds inside the fitted rows; widths and penalties of the
black boxes stand in `studies.moving.recordings`. No library with N4SID is among the dependencies.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from contid.kinematics.array import Array
from contid_identify.ahead import AHEAD_S, error_ahead, judged_ahead, predicted_tips
from contid_identify.answer import CommandedTrace
from contid_identify.moved_on import payload_of, recover
from contid_identify.printed import motion_lines
from contid_identify.sections.bent import ArmSections
from contid_identify.tip_fit.trace_rows import LoadedTrace, Statics
from contid_identify.tip_motion import AheadError, TipMotion
from contid_identify.tip_motion_fit import fit_tip_motion
from studies.moving.recordings import (
    DATA,
    LAGS_S,
    ORDER,
    PERIOD_S,
    _late,
    columns,
    kernel_ridge,
    ridge,
    smooth,
    table,
)
from studies.moving.trunk_statics import Trunk, fit_trunk, read

AXES = tuple(f"u{k}" for k in range(1, 7))
FITTED, JUDGED = 0.7, 0.73
#: Tips further than this from one row to the next are jumps of the cameras [m].
JUMP_M = 0.01


def recording(grams: int) -> tuple[Array, Array]:
    """Commands ``(rows, 6)`` [rad] and tips ``(rows, 3)`` [m] of one recording."""
    of = table(f"trunk-dynamic/random_a_{grams}g.csv.gz")
    sent = np.radians(columns(of, [f"u{k}_deg" for k in range(1, 7)]))
    return sent, 1e-3 * smooth(columns(of, ["x3_mm", "y3_mm", "z3_mm"]))


def trace(sent: Array, tip: Array, name: str) -> CommandedTrace:
    """One part of a recording."""
    return CommandedTrace(PERIOD_S, sent, np.arange(float(len(tip))) * PERIOD_S, tip, name)


def trunk_of(grams: int, share: float) -> Trunk:
    """The statics that the motor angles of a part of a recording give."""
    data = read(DATA / "moving" / "trunk-dynamic" / f"random_a_{grams}g.csv.gz")
    return fit_trunk(data[slice(0, int(share * len(data.angles)))])


def statics_of(trunk: Trunk) -> Statics:
    """Tips at rest by statics."""
    return lambda commands: trunk.discs_m(commands)[:, 2]


def sections_of(trunk: Trunk) -> ArmSections:
    """Sections and their bends by statics."""
    rest = trunk.bends(np.zeros((1, 6)))[0]
    by_axes = (trunk.bends(np.eye(6)) - rest).T.reshape(3, 2, 6)
    frame = Rotation.from_rotvec(trunk.turn).as_matrix()
    return ArmSections(trunk.length_m, np.zeros(3), by_axes, rest.reshape(3, 2), trunk.base_m, frame)


def shown(name: str, errors: Sequence[AheadError]) -> Iterator[str]:
    """Errors as lines."""
    for each in errors:
        ahead = f"{1e3 * each.ahead_s:.0f} ms ahead" if np.isfinite(each.ahead_s) else "commands alone"
        yield f"  {name:14} {ahead:16} {1e3 * each.rmse_m:6.2f} mm, 95 % within {1e3 * each.radius_m:.2f} mm"


def without_jumps(tip: Array) -> Array:
    """Rows with no jump within 0.2 s."""
    jumps = np.append(False, np.linalg.norm(np.diff(tip, axis=0), axis=1) > JUMP_M)
    return np.asarray(np.convolve(jumps, np.ones(41), mode="same") < 0.5)


def other_commands() -> Iterator[str]:
    """Open loop and ahead on commands that were not fitted."""
    sent, tip = recording(0)
    count = len(tip)
    fitted, first = int(FITTED * count), int(JUDGED * count)
    yield f"other commands: {fitted} rows fitted, {count - first} predicted"
    trunk = trunk_of(0, FITTED)
    good = without_jumps(tip)
    for name, sections in (("bends", sections_of(trunk)), ("map", None)):
        model = fit_tip_motion(
            "trunk", AXES, [LoadedTrace(trace(sent[:fitted], tip[:fitted], "0 g"))], statics_of(trunk), "",
            sections,
        )  # fmt: skip
        if sections is not None:
            yield from motion_lines(model)
            yield f"  degree {model.degree}, delays {np.round(1e3 * model.delay_s)} ms"
            yield f"  frequencies {np.round(model.frequency_hz, 2)} Hz"
            yield f"  ratios {np.round(model.ratio, 2)}"
        whole = trace(sent, tip, "0 g")
        tips = predicted_tips(model, sent, PERIOD_S, whole.at_s, whole.measured, 0.0)
        rows = tips.at_s >= first * PERIOD_S
        yield from shown(name, judged_ahead(model, [(tips, rows)]))
        kept = rows & good[np.minimum(np.round(tips.at_s / PERIOD_S).astype(int), count - 1)]
        yield from shown(f"{name} *", judged_ahead(model, [(tips, kept)]))
    yield "  * without rows within 0.2 s of a jump of the cameras"
    window = np.column_stack([_late(sent, round(lag_s / PERIOD_S)) for lag_s in LAGS_S])
    for name, method in (("linear FIR", ridge), ("kernel ridge", kernel_ridge)):
        predicted = method(window[:fitted], tip[:fitted], window[first:])
        yield from shown(name, [error_ahead(float("inf"), tip[first:] - predicted)])
    for ahead_s in AHEAD_S:
        ahead = round(ahead_s / PERIOD_S)
        inputs = np.column_stack([*(_late(tip, ahead + 5 * k) for k in range(ORDER)), window])
        error = tip[first:] - ridge(inputs[:fitted], tip[:fitted], inputs[first:])
        yield from shown("linear ARX", [error_ahead(ahead_s, error)])
        yield from shown("linear ARX *", [error_ahead(ahead_s, error[good[first:]])])


def payload() -> tuple[TipMotion, list[str]]:
    """A mass between those of the fit: given, and found."""
    traces = [LoadedTrace(trace(*recording(grams), f"{grams} g"), 1e-3 * grams) for grams in (0, 300)]
    model = fit_tip_motion("trunk", AXES, traces, None, "", sections_of(trunk_of(0, 1.0)))
    sent, tip = recording(100)
    whole = trace(sent, tip, "100 g")
    tips = predicted_tips(model, sent, PERIOD_S, whole.at_s, whole.measured, 0.1)
    out = [
        "payload: fitted to 0 and 300 g, predicted 100 g",
        *shown("given", judged_ahead(model, [(tips, tips.at_s > 3.0)])),
    ]
    not_given = whole.measured - model.predict(sent, PERIOD_S, whole.at_s, 0.0)
    out += shown("taken for 0 g", [error_ahead(float("inf"), not_given)])
    for window_s in (5.0, 10.0):
        off, held = masses(model, whole, 3.0, window_s, 100.0)
        out.append(
            f"  mass from {window_s:.0f} s: {np.sqrt((off**2).mean()):.1f} g rms, mean {off.mean():+.1f} g; "
            f"{100 * held:.0f} % of {len(off)} intervals hold it"
        )
    traces = []
    for grams in (0, 100, 300):
        sent, tip = recording(grams)
        fitted = int(FITTED * len(tip))
        traces.append(LoadedTrace(trace(sent[:fitted], tip[:fitted], f"{grams} g"), 1e-3 * grams))
    other = fit_tip_motion("trunk", AXES, traces, None, "", sections_of(trunk_of(0, FITTED)))
    out.append(f"payload: three fitted, other commands; less per kg {other.less_per_kg:.2f}")
    for grams in (100, 300):
        sent, tip = recording(grams)
        whole = trace(sent, tip, "")
        tips = predicted_tips(other, sent, PERIOD_S, whole.at_s, whole.measured, 1e-3 * grams)
        judged = judged_ahead(other, [(tips, tips.at_s >= JUDGED * len(tip) * PERIOD_S)])
        out += shown(f"{grams} g given", judged[-1:])
        for window_s in (5.0, 10.0):
            off, _ = masses(other, whole, JUDGED * len(tip) * PERIOD_S, window_s, grams)
            out.append(
                f"  mass from {window_s:.0f} s: {np.sqrt((off**2).mean()):.1f} g rms ({len(off)} windows)"
            )
    return model, out


def masses(
    model: TipMotion, whole: CommandedTrace, from_s: float, window_s: float, grams: float
) -> tuple[Array, float]:
    """Errors of the mass [g] from windows of a recording, and the share of intervals that hold the truth."""
    found = []
    for begin_s in np.arange(from_s, whole.at_s[-1] - window_s, window_s):
        rows = (whole.at_s >= begin_s) & (whole.at_s < begin_s + window_s)
        found.append(payload_of(model, whole.picked(rows)))
    held = np.mean([1e3 * each.low <= grams <= 1e3 * each.high for each in found])
    return np.array([1e3 * each.value - grams for each in found]), float(held)


def recovered(model: TipMotion) -> Iterator[str]:
    """Commands changed as on another day."""
    sent, tip = recording(0)
    first = int(JUDGED * len(tip))
    draw = np.random.default_rng(50)
    gains, zeros = draw.uniform(0.85, 1.15, 6), 0.1 * sent.std(axis=0) * draw.choice([-1.0, 1.0], 6)
    changed = np.roll(sent, -18, axis=0) / gains + zeros
    part = trace(changed[first:-20], tip[first:-20], "changed")
    found = recover(model, part, 20.0)
    yield "another day in its place: commands changed, recovered from 20 s"
    yield f"  delay {1e3 * found.later_s.value:+.0f} +- {1e3 * found.later_s.half:.0f} ms (truth +180)"
    off = np.abs(np.array([each.value for each in found.gains]) - gains).mean()
    yield f"  gains of the axes off by {off:.3f} (mean), changed by {np.abs(gains - 1.0).mean():.3f}"
    yield from shown("before", [found.before])
    yield from shown("tip re-zeroed", [found.zeroed])
    yield from shown("recovered", [found.after])


def report() -> Iterator[str]:
    """All tables."""
    yield from other_commands()
    model, text = payload()
    yield from text
    yield from recovered(model)


if __name__ == "__main__":
    for line in report():
        print(line, flush=True)  # noqa: T201
