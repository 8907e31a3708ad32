"""Cold starts: random reachable targets solved from one fixed start, far from the answer.

Targets are tips of random pressures in [0, 1.5] bar with a weight on the tip, tip down, in a stable
equilibrium. A failure is a target that is not met; some answers that report success are checked by the
forward statics.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from contid.kinematics.cosserat.engine import NumpyEngine, build_engine
from contid.kinematics.cosserat.equilibrium import newton
from studies.shi_experiments import GRAVITY_M_S2, arm, setup

MODES = {"one segment, tip": (0,), "mid + tip": (0, 1), "tip + direction": (0, 1)}
#: One answer out of this many is checked.
CHECK_EVERY = 20
CHECK_TOLERANCE_MM = 1e-3


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
    engine, spec = build_engine(whole), NumpyEngine(whole)
    n = whole.rod.pressures
    force = (0.0, 0.0, grams * 1e-3 * GRAVITY_M_S2)
    start = (0.5,) * n
    times: list[float] = []
    failures = checked = wrong = 0
    while len(times) < targets:
        tip, R, mid, stable, _, _ = engine.forward(rng.uniform(0.0, 1.5, n).tolist(), force)
        if not stable:
            continue
        given_mid = mid if mode == "mid + tip" else None
        direction = (R[2], R[5], R[8]) if mode == "tip + direction" else None
        begun = time.perf_counter()
        answer = engine.inverse(tip, given_mid, direction, force, start)  # type: ignore[arg-type]  # of three
        times.append(time.perf_counter() - begun)
        met = answer[2] and answer[4]
        failures += not met
        if met and len(times) % CHECK_EVERY == 0:
            checked += 1
            loads = spec.setup.loads(force)
            found = newton(whole.rod, np.array(answer[0]), np.cross(tip, force), loads, answer[6])
            off = float(np.linalg.norm(found.sweep.tip - tip))
            wrong += not (found.converged and off < CHECK_TOLERANCE_MM)
    us = np.array(times) * 1e6
    return Cold(
        mode, grams, targets, failures, checked, wrong,
        float(np.median(us)), float(np.percentile(us, 99)), float(np.max(us)),
    )  # fmt: skip


def campaign(targets: int) -> Iterator[Cold]:
    """Every mode at 0, 5 and 10 g."""
    for mode in MODES:
        for grams in (0.0, 5.0, 10.0):
            yield cold_starts(mode, grams, targets)
