"""Curvature calibration: circles at any curvature, the paper's line from synthetic markers, invalid data."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contid.errors import BadInputError, ContidError
from contid_fit.calibrate.circle import fit_circle
from contid_fit.calibrate.curvature import CurvatureFit, fit_curvature, read_postures
from tests.support.photographs import PX_PER_MM, A, B, markers, photograph


def fitted(noise_px: float) -> CurvatureFit:
    text = photograph(noise_px).splitlines()
    return fit_curvature(read_postures(text, "m.csv", rack_spacing_mm=13, mm_per_px=1 / PX_PER_MM))


@pytest.mark.parametrize("curvature", [0.0, 1e-9, 1e-5, 0.01, 0.05, 0.2])
def test_a_circle_fit_is_exact_from_straight_to_curled(curvature: float) -> None:
    fit = fit_circle(markers(60, curvature) * (1, -1) + (300, -20))
    assert fit.curvature == pytest.approx(curvature, abs=1e-9)
    assert fit.rms < 1e-9


def test_the_standard_error_of_a_circle_fit_matches_its_scatter() -> None:
    rng = np.random.default_rng(1)
    curvatures, errors = [], []
    for _ in range(200):
        fit = fit_circle(markers(80, 0.03) + rng.normal(0, 0.2, (12, 2)))
        curvatures.append(fit.curvature)
        errors.append(0.2 * fit.error_per_noise)
    assert np.std(curvatures) == pytest.approx(np.mean(errors), rel=0.2)
    assert np.mean(curvatures) == pytest.approx(0.03, rel=5e-3)


def test_the_papers_line_comes_back_exactly_without_noise() -> None:
    fit = fitted(0.0)
    assert fit.a_per_mm == pytest.approx(A, rel=1e-9)
    assert fit.b == pytest.approx(B, rel=1e-9)
    assert fit.arc_length_mm == pytest.approx((40, 100))


def test_the_papers_line_lies_in_the_confidence_interval_with_noise() -> None:
    fit = fitted(0.5)
    assert abs(fit.a_per_mm - A) < fit.a_half_width_per_mm < 5e-4
    assert abs(fit.b - B) < fit.b_half_width < 0.05
    assert 0 < fit.rms_epsilon < 0.05


def test_a_straight_finger_is_refused() -> None:
    rows = [f"p,50,0.02,{i},{2 * i}" for i in range(6)]
    text = ["posture,arc_length_mm,curvature_per_mm,x_mm,y_mm", *rows]
    with pytest.raises(BadInputError, match="on a line"):
        read_postures(text, "m.csv", rack_spacing_mm=13, mm_per_px=None)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda t: t.replace("x_px", "x_pix"), "unknown column 'x_pix'"),
        (lambda t: t.replace("posture,", "pose,"), "column posture is missing"),
        (lambda t: t.replace("S40 k0.01,", "S40 k0.01,nan"), "is not a finite number"),
        (lambda t: "\n".join(t.splitlines()[:3]), "a circle needs three different points"),
        (lambda t: "", "empty"),
    ],
)
def test_invalid_data_are_located(edit, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        read_postures(edit(photograph(0)).splitlines(), "m.csv", rack_spacing_mm=13, mm_per_px=0.2)


def test_pixels_need_their_size() -> None:
    with pytest.raises(BadInputError, match="--mm-per-px"):
        read_postures(photograph(0).splitlines(), "m.csv", rack_spacing_mm=13, mm_per_px=None)


@pytest.mark.parametrize(("count", "enough"), [(2, False), (3, True)])
def test_a_line_and_its_interval_need_three_postures(count: int, enough: bool) -> None:
    """Two postures at two arc lengths have a line, but no residual to judge it by."""
    postures = read_postures(photograph(0.5).splitlines(), "m.csv", rack_spacing_mm=13, mm_per_px=0.2)
    by_length = {posture.arc_length_mm: posture for posture in postures}
    chosen = [*by_length.values()][:count]
    assert len(chosen) == count
    if enough:
        assert math.isfinite(fit_curvature(chosen).a_half_width_per_mm)
        return
    with pytest.raises(ContidError, match=r"2 postures at 2 arc lengths .* at least three postures"):
        fit_curvature(chosen)


def test_one_arc_length_does_not_determine_a_line() -> None:
    text = [line for line in photograph(0).splitlines() if line.startswith(("posture", "S40"))]
    with pytest.raises(ContidError, match="do not determine a line"):
        fit_curvature(read_postures(text, "m.csv", rack_spacing_mm=13, mm_per_px=0.2))
