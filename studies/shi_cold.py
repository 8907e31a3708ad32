"""Cold starts: random reachable targets solved from one fixed start, far from the answer.

Targets are tips of random pressures in [0, 1.5] bar with a weight on the tip, tip down, in a stable
equilibrium. A failure is a target that is not met; some answers that report success are checked by the
paper's literal equations.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.engine import RodSolver
from contid.kinematics.cosserat.section import Rod
from studies.shi import integrate, unknowns
from studies.shi_experiments import GRAVITY_M_S2, arm, setup

MODES = {"one segment, tip": (0,), "mid + tip": (0, 1), "tip + direction": (0, 1)}
#: One answer out of this many is checked.
CHECK_EVERY = 20
#: Elements of the check, and how far the two discretisations may be apart.
CHECK_ELEMENTS, CHECK_TOLERANCE_MM = 48, 0.1
CHECK_STEPS, CHECK_BALANCE_NMM = 10, 1e-8


@dataclass(frozen=True, slots=True)
class Cold:
    """One mode under one load: targets, those not met, wrong claims among those checked, times [us]."""

    mode: str
    grams: float
    targets: int
    failures: int
    checked: int
    wrong_claims: int
    median_us: float
    p99_us: float
    worst_us: float


def cold_starts(mode: str, grams: float, targets: int, seed: int = 7) -> Cold:
    """Solve ``targets`` random targets of a mode from 0.5 bar in every chamber."""
    rng = np.random.default_rng(seed)
    whole = setup(arm(MODES[mode]))
    engine = RodSolver(whole)
    n = whole.rod.pressures
    force = (0.0, 0.0, grams * 1e-3 * GRAVITY_M_S2)
    start = (0.5,) * n
    times: list[float] = []
    failures = checked = wrong = 0
    while len(times) < targets:
        at = engine.forward(rng.uniform(0.0, 1.5, n).tolist(), force)
        if not at.stable:
            continue
        given_mid = at.mid_mm if mode == "mid + tip" else None
        direction = (at.rotation[2], at.rotation[5], at.rotation[8]) if mode == "tip + direction" else None
        begun = time.perf_counter()
        answer = engine.inverse(at.tip_mm, given_mid, direction, force, start)
        times.append(time.perf_counter() - begun)
        met = answer.met and answer.stable
        failures += not met
        if met and len(times) % CHECK_EVERY == 0:
            checked += 1
            wrong += not _is_held(whole.rod, answer.pressures_bar, np.array(at.tip_mm), np.array(force))
    us = np.array(times) * 1e6
    return Cold(
        mode, grams, targets, failures, checked, wrong,
        float(np.median(us)), float(np.percentile(us, 99)), float(np.max(us)),
    )  # fmt: skip


def _is_held(rod: Rod, bar: tuple[float, ...], tip: Array, force: Array) -> bool:
    """True where the paper's equations are in balance next to a tip: Newton's method on the base moment."""
    moment, step = np.cross(tip, force), 1e-6
    for _ in range(CHECK_STEPS):
        trials = [unknowns(rod, np.array(bar), force, m) for m in moment + step * np.eye(4, 3, -1)]
        start = np.array(trials)
        ends = integrate(rod, start[:, 6:], start[:, :3], start[:, 3:6], force, CHECK_ELEMENTS)
        left = ends.moment_error[0]
        if float(np.linalg.norm(left)) < CHECK_BALANCE_NMM:
            return float(np.linalg.norm(ends.tip[0] - tip)) < CHECK_TOLERANCE_MM
        moment = moment - np.linalg.solve(((ends.moment_error[1:] - left) / step).T, left)
    return False


def campaign(targets: int) -> Iterator[Cold]:
    """Every mode at 0, 5 and 10 g."""
    for mode in MODES:
        for grams in (0.0, 5.0, 10.0):
            yield cold_starts(mode, grams, targets)
