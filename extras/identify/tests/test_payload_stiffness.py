"""Payloads between two recorded ones: beams that hang and stand, by closed forms of beam-columns."""

from __future__ import annotations

import numpy as np
import pytest

from contid_identify.answer import CommandedTrace
from contid_identify.moved_on import payload_of
from contid_identify.tip_fit.trace_rows import LoadedTrace
from contid_identify.tip_motion_fit import fit_tip_motion

pytestmark = pytest.mark.slow

PERIOD_S = 0.02
LENGTH_M = 0.32
G = 9.81


def gain(load_kg: float, bending_n_m2: float) -> float:
    """Tip displacement of a beam with a curvature of its own and a weight at its tip, as a share.

    EI (w'' - k) = -m g (w(L) - w) of one that hangs, with w(0) = w'(0) = 0 (Timoshenko and Gere, Theory of
    Elastic Stability, 1961, section 1.11): w(L) = k (1 - 1 / cosh a) L^2 / a^2, a^2 = m g L^2 / EI. One that
    stands has a negative weight, and a cosine in place of the other.
    """
    squared = load_kg * G * LENGTH_M**2 / bending_n_m2
    if abs(squared) < 1e-9:
        return 1.0
    a = np.sqrt(abs(squared))
    return float(2.0 * (1.0 - 1.0 / (np.cosh(a) if squared > 0.0 else np.cos(a))) / squared)


def trace_of(seed: int, load_kg: float, bending_n_m2: float, duration_s: float = 30.0) -> CommandedTrace:
    """Two axes that bend the beam 0.1 s late, with 0.3 mm of noise."""
    draw = np.random.default_rng(seed)
    at_s = np.arange(0.0, duration_s, PERIOD_S, dtype=np.float64)
    sent = np.zeros((len(at_s), 2))
    for axis in range(2):
        for hz in draw.uniform(0.1, 1.0, 8):
            sent[:, axis] += np.sin(2.0 * np.pi * hz * at_s + draw.uniform(0.0, 6.28)) / 5.0
    late = np.concatenate([np.repeat(sent[:1], 5, axis=0), sent[:-5]])
    side = gain(load_kg, bending_n_m2) * 0.05 * late
    tips = np.column_stack([side, np.full(len(side), LENGTH_M)]) + draw.normal(0.0, 3e-4, (len(side), 3))
    return CommandedTrace(PERIOD_S, sent, at_s, tips, f"seed {seed}")


@pytest.mark.parametrize(("lesser_kg", "bending_n_m2"), [(0.0, 0.2), (0.05, 0.2), (0.0, -0.4)])
def test_a_mass_between_two_payloads(lesser_kg: float, bending_n_m2: float) -> None:
    """A straight line between the two would be off by 13 to 31 g; the penalty of the map takes 4 g."""
    with pytest.MonkeyPatch.context() as few:
        few.setattr("contid_identify.remembered.MOST", 200)
        traces = [
            LoadedTrace(trace_of(1, lesser_kg, bending_n_m2), lesser_kg),
            LoadedTrace(trace_of(2, 0.3, bending_n_m2), 0.3),
        ]
        model = fit_tip_motion("beam", ("a", "b"), traces, None, "a test")
    found = payload_of(model, trace_of(7, 0.1, bending_n_m2))
    print(f"{1e3 * found.value:.1f} +- {1e3 * found.half:.1f} g, 1 / m0 {model.less_per_kg:.2f} per kg")
    assert 1e3 * abs(found.value - 0.1) < 8.0
    assert (model.less_per_kg > 0.0) == (bending_n_m2 > 0.0)
