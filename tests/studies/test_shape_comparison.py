"""The paper's Tables II and III, simulated: equal to the reference (part E.5)."""

from __future__ import annotations

import pytest

from studies.shape_comparison import compare_shapes


def test_the_reference_s_figures_on_the_golden_trajectory() -> None:
    unknown, known, alone, newton, biarc, bounded = compare_shapes()
    assert max(unknown.max_mm) == pytest.approx(2.40, abs=0.01)
    assert unknown.mean_mm == pytest.approx((0.42, 0.32, 0.43), abs=0.02)
    assert known.mean_mm == pytest.approx((0.19, 0.19, 0.25), abs=0.01)
    assert known.six_max_mm == pytest.approx(3.55, abs=0.01)
    assert newton.mean_mm == pytest.approx((7.1, 5.1, 8.6), abs=0.1)
    assert newton.six_max_mm == pytest.approx(33.9, abs=0.1)
    # Given as much as Newton-Raphson, the quintic still has the better totals; its tip is a single arc's.
    assert max(alone.mean_mm) < min(newton.mean_mm)
    assert alone.tip_max_mm < 0.06
    # One quintic is not two arcs: with their true direction the tip is where it cannot follow.
    assert unknown.tip_mean_mm == pytest.approx(6.5, abs=0.1)
    assert bounded.tip_max_mm < 1e-5
    # Given the direction too, constant curvature is better than a quintic where the arm has it.
    assert max(biarc.mean_mm + bounded.mean_mm) < min(unknown.mean_mm)


def test_tracker_noise_explains_the_errors_of_the_paper() -> None:
    unknown = compare_shapes(noise_mm=1.0, noise_deg=1.0, laps=2)[0]
    assert 0.8 < sum(unknown.mean_mm) / 3.0 < 1.3
    assert max(unknown.max_mm) < 6.0
