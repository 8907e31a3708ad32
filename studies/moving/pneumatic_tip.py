"""The tip of a pneumatic arm in motion, patterns kept out: the product's arcs of chambers beside black boxes.

``CONTID_SHARED_DATA=.. python -m studies.moving.pneumatic_tip`` prints the table.

Recordings: ASU-RISE-Lab/4-chamber-softarm-control (MIT, (c) 2023 ASU-RISE-Lab), repacked. The split:

* unseen patterns: each of the seven ``step_15_*`` by a fit to the six others;
* same pattern: ``steps_mar_1``, which has the pattern of ``step_15_1`` on another day, by a fit to the seven;
* a sequence: ``long_a``, five of the seven patterns one after another in another session, by a fit to the
  seven; and what follows its first 40 s by a fit to these 40 s and the seven.

All of it from set-points alone, and fitted to tips alone. Every method is set to zero on the first 0.2 s,
before anything moves. The columns ``set2`` act on the upper section and ``set1`` on the lower one, as the
poses of ``step_15_5`` show; the README has them the other way round.

The form of `contid_identify.chambers` (a longest length that bounds bends, a play in the length) was found
by looking at bends and lengths of these recordings, ``long_a`` among them; its numbers are those of each fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from contid.kinematics.array import Array
from contid_identify.answer import CommandedTrace
from contid_identify.chambers.fit import fit_chamber_motion
from contid_identify.chambers.motion import ChamberArm
from contid_identify.tip_fit.trace_rows import LoadedTrace
from contid_identify.tip_motion_fit import fit_tip_motion
from studies.moving.recordings import _late, columns, kernel_ridge, ridge, table

PERIOD_S: Final = 0.05
#: Rest before the recording [s], so that windows of commands begin at rest.
BEFORE: Final = round(2.0 / PERIOD_S)
STEPS: Final = tuple(f"step_15_{k}" for k in range(1, 8))
REST_PSI, STEP_PSI = 1.0, 14.0
#: Chambers to the right, to the left and in the middle of the upper section, then of the lower one [m].
ARM: Final = ChamberArm(
    np.repeat((0, 1), 3), np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 0.0]] * 2), np.full(2, 0.12), np.zeros(2)
)
AXES: Final = tuple(f"{section}.{chamber}" for section in ("upper", "lower") for chamber in ("r", "l", "m"))
#: Past commands of the black boxes [s].
LAGS_S: Final = (0.0, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0, 1.4, 1.8, 2.4, 3.0, 4.0, 6.0, 9.0)
#: Orders of N4SID, and block rows at steps of 0.2 s.
STATES: Final = 8
BLOCK_ROWS: Final = 12
EVERY: Final = round(0.2 / PERIOD_S)
#: Inflated for this long on two days [s].
_ENDS: Final = (("step_15_1", 9.9), ("steps_mar_1", 9.9))


@dataclass(frozen=True, eq=False)
class PneumaticRun:
    """One recording on equal steps.

    Attributes:
        sent: set-points as shares of a step ``(rows, 6)``, upper section first, with `BEFORE` rows of rest.
        tip: from the base ``(samples, 3)`` [mm], as recorded: z is up.
    """

    sent: Array
    tip: Array

    @property
    def at_s(self) -> Array:
        """Times of the tips."""
        return np.asarray((BEFORE + np.arange(float(len(self.tip)))) * PERIOD_S)

    def trace(self, own: slice, name: str = "") -> CommandedTrace:
        """Some of the tips as the product takes them, in a base frame whose z points down the arm."""
        tip = 1e-3 * self.tip * [1.0, -1.0, -1.0]
        return CommandedTrace(PERIOD_S, self.sent, self.at_s[own], tip[own], name)


def read(name: str) -> PneumaticRun:
    """One recording on equal steps."""
    of = table(f"pneumatic-planar/{name}.csv.gz")
    at_s = np.arange(0.0, of["t_s"][-1], PERIOD_S)
    rows = np.clip(np.searchsorted(of["t_s"], at_s, side="right") - 1, 0, None)
    sets = columns(of, [f"set{k}_{c}_psi" for k in (2, 1) for c in (1, 2, 3)])[rows]
    base = columns(of, [f"base_{c}_mm" for c in "xyz"]).mean(axis=0)
    tip = np.column_stack([np.interp(at_s, of["t_s"], of[f"tip_{c}_mm"]) for c in "xyz"]) - base
    # `long_a` begins between two steps, at 2 psi.
    rest = np.full((BEFORE, 6), sets[-1, 0] if name == "long_a" else REST_PSI)
    return PneumaticRun((np.vstack((rest, sets)) - REST_PSI) / STEP_PSI, tip)


def arcs(
    runs: Mapping[str, PneumaticRun], rows: Mapping[str, slice], judged: PneumaticRun
) -> dict[str, Array]:
    """Tips by the arcs of chambers, with what they remember and without."""
    traces = [runs[name].trace(own, name) for name, own in rows.items()]
    model = fit_chamber_motion("arm", AXES, ARM, traces, "", kept_out=False)
    whole = judged.trace(slice(None))
    model = model.zeroed(whole.sent, PERIOD_S, whole.at_s, whole.measured)
    models = {"arcs": model, "arcs alone": replace(model, remembered=None)}
    return {
        name: 1e3 * each.predict(whole.sent, PERIOD_S, whole.at_s) * [1.0, -1.0, -1.0]
        for name, each in models.items()
    }


def zeroed(run: PneumaticRun, tips: Array) -> Array:
    """Tips moved so that the first 0.2 s fit."""
    return np.asarray(tips + (run.tip[:4] - tips[:4]).mean(axis=0))


def window(run: PneumaticRun) -> Array:
    """Past commands side by side."""
    return np.column_stack([_late(run.sent, round(lag_s / PERIOD_S)) for lag_s in LAGS_S])[BEFORE:]


def tip_motion(runs: Mapping[str, PneumaticRun], rows: Mapping[str, slice], judged: PneumaticRun) -> Array:
    """Tips by `TipMotion`, the map of the product, without statics."""
    traces = [LoadedTrace(runs[name].trace(own, name)) for name, own in rows.items()]
    model = fit_tip_motion("arm", AXES, traces, None, "")
    return np.asarray(1e3 * model.predict(judged.sent, PERIOD_S, judged.at_s) * [1.0, -1.0, -1.0])


def n4sid(runs: Mapping[str, PneumaticRun], rows: Mapping[str, slice], judged: PneumaticRun) -> Array | None:
    """Tips by N4SID (the package nfoursid), open loop from rest; None where it is not installed."""
    try:
        import pandas
        from nfoursid.nfoursid import NFourSID
    except ModuleNotFoundError:
        return None
    parts = [(run.sent[BEFORE:][own][::EVERY], (run.tip - run.tip[0])[own][::EVERY])
             for name, own in rows.items() for run in (runs[name],)]  # fmt: skip
    inputs, outputs = (np.concatenate(each) for each in zip(*parts, strict=True))
    names = [[f"{kind}{k}" for k in range(n)] for kind, n in (("u", 6), ("y", 3))]
    frame = pandas.DataFrame(np.column_stack((inputs, outputs)), columns=names[0] + names[1])
    found = NFourSID(frame, output_columns=names[1], input_columns=names[0], num_block_rows=BLOCK_ROWS)
    found.subspace_identification()
    system, _ = found.system_identification(rank=STATES)
    x, out = np.zeros((STATES, 1)), []
    for u in judged.sent[BEFORE:][::EVERY, :, None]:
        out.append((system.c @ x + system.d @ u).ravel())
        x = system.a @ x + system.b @ u
    steps = np.arange(float(len(judged.tip))) / EVERY
    return np.column_stack([np.interp(steps, np.arange(float(len(out))), c) for c in np.array(out).T])


def rmse(run: PneumaticRun, tips: Array, own: slice) -> float:
    """Of the distance [mm]."""
    return float(np.sqrt(((run.tip - zeroed(run, tips)) ** 2).sum(axis=1)[own].mean()))


class Apart(NamedTuple):
    """RMSE of distances [mm], with the zero of the recording and with a zero of each part."""

    same_zero: float
    own_zeros: float


def repeated(run: PneumaticRun) -> Apart:
    """How far the second inflation of ``steps_mar_1`` is from the first one, over its 10 s."""
    blown = run.sent[BEFORE:, 0] > 0.5
    first, begin = (np.flatnonzero(np.diff(blown.astype(int), prepend=0) == 1)).tolist()
    rows = round(9.9 / PERIOD_S)
    apart = run.tip[begin : begin + rows] - run.tip[first : first + rows]
    own = apart - (run.tip[begin - 1] - run.tip[:4].mean(axis=0))
    return Apart(rms(apart), rms(own))


def phases(run: PneumaticRun, fitted: PneumaticRun, tips: Array) -> Iterator[str]:
    """What predictions of ``steps_mar_1`` are off by while inflated and vented, beside a copy.

    The copy is the tip of the same pattern on the day that was fitted, as long after the same step: as near
    as a model can be that repeats that day.
    """
    steps = {up: np.flatnonzero(np.diff(each.sent[BEFORE:, 0] > 0.5, prepend=False))
             for up, each in (("judged", run), ("copied", fitted))}  # fmt: skip
    begins = np.append(steps["judged"], len(run.tip))
    zero = run.tip[:4].mean(axis=0) - fitted.tip[:4].mean(axis=0)
    for number, (begin, end) in enumerate(zip(begins[:-1].tolist(), begins[1:].tolist(), strict=True)):
        first = int(steps["copied"][number % 2])
        rows = min(end - begin, round(9.9 / PERIOD_S), len(fitted.tip) - first)
        own = slice(begin, begin + rows)
        copied = rms(run.tip[own] - fitted.tip[first : first + rows] - zero)
        off = run.tip[own] - zeroed(run, tips)[own]
        yield (
            f"  {('inflated', 'vented')[number % 2]} at {begin * PERIOD_S:.0f} s, {rows * PERIOD_S:.1f} s: "
            f"arcs {rms(off):.1f}, of it a constant {np.linalg.norm(off.mean(axis=0)):.1f}; "
            f"copy {copied:.1f} mm"
        )


def rms(apart: Array) -> float:
    """Of distances, of differences ``(rows, 3)``."""
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


def report() -> Iterator[str]:
    """The table."""
    runs = {name: read(name) for name in (*STEPS, "steps_mar_1", "long_a")}
    same, own_zeros = repeated(runs["steps_mar_1"])
    yield f"second inflation of steps_mar_1 beside its first: {same:.1f} mm, own zeros {own_zeros:.1f} mm"
    moved = [runs[name].tip[round(at_s / PERIOD_S)] - runs[name].tip[:4].mean(axis=0) for name, at_s in _ENDS]
    apart = float(np.linalg.norm(moved[1] - moved[0]))
    yield f"after 10 s of step_15_1 and of steps_mar_1, the same step: {apart:.1f} mm apart"
    every = slice(None)
    seven = dict.fromkeys(STEPS, every)
    part = {**seven, "long_a": slice(0, round(40.1 / PERIOD_S))}
    ends = (40.3, 50.2, 60.2)
    after = {f"long_a, {a:.0f} s on": slice(round(a / PERIOD_S), round((a + 9.9) / PERIOD_S)) for a in ends}
    cases: list[tuple[str, dict[str, slice], dict[str, slice]]] = [
        (name, {k: every for k in STEPS if k != name}, {f"unseen {name}": every}) for name in STEPS
    ]
    cases += [("steps_mar_1", seven, {"same pattern, another day": every})]
    cases += [("long_a", seven, {"long_a, a sequence in another session": every}), ("long_a", part, after)]
    for name, rows, judged in cases:
        run = runs[name]
        x = np.concatenate([window(runs[k])[own] for k, own in rows.items()])
        y = np.concatenate([runs[k].tip[own] for k, own in rows.items()])
        found: dict[str, Array | None] = {
            **arcs(runs, rows, run),
            "map": tip_motion(runs, rows, run),
            "kernel ridge": kernel_ridge(x, y, window(run)),
            "linear FIR": ridge(x, y, window(run)),
            "N4SID": n4sid(runs, rows, run),
            "at rest": np.tile(run.tip[:1], (len(run.tip), 1)),
        }
        for text, own in judged.items():
            errors = (f"{k} {rmse(run, t, own):.1f}" for k, t in found.items() if t is not None)
            yield f"{text}: {', '.join(errors)} mm"
        if name == "steps_mar_1" and (tips := found["arcs"]) is not None:
            yield from phases(run, runs["step_15_1"], tips)


if __name__ == "__main__":
    for line in report():
        print(line, flush=True)  # noqa: T201
