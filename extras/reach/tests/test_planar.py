"""Reach of planar fingers against the quadratures and the Monte Carlo of the reference (A3)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from shapely.geometry.base import BaseGeometry

from contid.kinematics.rack.finger import RackFingerModel
from contid.robot_file.base import BasePose
from contid.robot_file.rack_finger import RackFinger
from contid_reach.planar import area_cm2, overlapping, planar_regions
from contid_reach.two_link import two_link_overlap, two_link_region


def two_fingers(h_mm: float, w_mm: float = 13.0, curvature: float = 0.076) -> dict[str, BaseGeometry]:
    model = RackFingerModel(
        RackFinger.model_validate(
            {
                "model": "rack_finger",
                "geometry": {
                    "rack_spacing_mm": w_mm,
                    "tip_length_mm": h_mm,
                    "link": {"length_mm": 6, "width_mm": 13, "gap_mm": 5},
                },
                "limits": {
                    "length_mm": (0, 100),
                    "curvature_max_per_mm": curvature,
                    "arc_length_min_mm": 1e-3,
                },
                "rates": {},
            }
        )
    )
    bases = {"left": BasePose(), "right": BasePose(x_mm=100, mirror_x=True)}
    return planar_regions({"left": model, "right": model}, bases)


@pytest.mark.parametrize(
    ("h_mm", "single", "overlap"),
    [
        (0, 101.97313915, 11.55016853),
        pytest.param(5, 116.06, 18.70036, marks=pytest.mark.campaign),
        (10, 130.15, 27.55655),
        pytest.param(20, 158.50, 46.07, marks=pytest.mark.campaign),
        (30, 187.30, 56.00),
    ],
)
def test_areas_of_the_reference(h_mm: float, single: float, overlap: float) -> None:
    regions = two_fingers(h_mm)
    digits = 5e-5 if h_mm == 0 else 6e-3
    assert area_cm2(regions["left"]) == pytest.approx(single, abs=digits)
    # Monte Carlo in the reference from h = 15 on: two decimals.
    common = overlapping(regions)["left", "right"]
    assert area_cm2(common) == pytest.approx(overlap, abs=2e-5 if h_mm < 15 else 0.04)


@pytest.mark.parametrize(
    ("w_mm", "overlap"),
    [
        (8, 17.71),
        pytest.param(10, 15.11, marks=pytest.mark.campaign),
        pytest.param(12, 12.69, marks=pytest.mark.campaign),
    ],
)
def test_overlap_depends_on_the_rack_spacing(w_mm: float, overlap: float) -> None:
    common = overlapping(two_fingers(0, w_mm))["left", "right"]
    assert area_cm2(common) == pytest.approx(overlap, abs=6e-3)


def test_curvature_limit_does_not_change_the_overlap() -> None:
    narrow, wide = two_fingers(0, curvature=0.05), two_fingers(0, curvature=0.1)
    pair = ("left", "right")
    common = [area_cm2(overlapping(regions)[pair]) for regions in (narrow, wide)]
    assert common[0] == pytest.approx(common[1], abs=1e-4)
    assert area_cm2(narrow["left"]) < area_cm2(wide["left"]) - 1


@pytest.mark.parametrize(
    ("w_mm", "curvature"),
    [
        pytest.param(13, 0.076, marks=pytest.mark.campaign),
        pytest.param(5, 0.12, marks=pytest.mark.campaign),
        (2, 0.3),
    ],
)
def test_the_area_is_the_integral_of_the_jacobian_for_slender_fingers_too(w_mm, curvature) -> None:
    """``|d(x, y)/d(k, S)| = S^2/2 sinc(k S/2)^2`` for h = 0; slender fingers reach a full turn (16 rad)."""
    s = np.linspace(1e-3, 100.0, 4001)
    greatest = np.minimum(np.minimum(curvature, 2.0 * (100.0 / s - 1.0) / w_mm), 2.0 * math.pi / s)
    share = np.linspace(-1.0, 1.0, 401)[:, None]
    swept = 0.5 * s**2 * np.sinc(share * greatest * s / (2.0 * math.pi)) ** 2
    area = np.trapezoid(np.trapezoid(swept, share[:, 0], axis=0) * greatest, s) / 100.0
    found = area_cm2(two_fingers(0, w_mm, curvature)["left"])
    assert found == pytest.approx(float(area), rel=1e-5)


@pytest.mark.parametrize(
    ("joint_deg", "overlap"), [(50, 0.98326122), (98, 14.3506244), (99, 15.3276311), (98.4379, 14.77)]
)
def test_two_link_fingers(joint_deg: float, overlap: float) -> None:
    found = area_cm2(two_link_overlap(math.radians(joint_deg), 0.1))
    assert found == pytest.approx(overlap, abs=1e-4 if joint_deg != 98.4379 else 2e-3)


def test_the_two_link_region_is_mirror_symmetric_and_grows() -> None:
    from shapely.affinity import scale

    small, large = two_link_region(math.radians(50)), two_link_region(math.radians(60))
    assert small.symmetric_difference(scale(small, xfact=-1, origin=(0, 0))).area == pytest.approx(
        0, abs=1e-12
    )
    assert large.contains(small.buffer(-1e-6))
