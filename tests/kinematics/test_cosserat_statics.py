"""Integration and equilibrium against the golden rows, the elastica and finite differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contid.kinematics.array import Array
from contid.kinematics.cosserat.compliance import sweep
from contid.kinematics.cosserat.element import exp_se3
from contid.kinematics.cosserat.section import Loads, Rod, Section
from tests.kinematics.cosserat_cases import (
    GOLDEN,
    hanging,
    loads_of,
    one,
    rod_of,
    section,
    solver,
    standing,
    two,
)

FK = GOLDEN["fk"]


def test_section_constants() -> None:
    s = section(0)
    assert s.chamber_area == pytest.approx(4.9087385212, abs=1e-10)
    assert s.area == pytest.approx(124.3599451924, abs=1e-10)
    assert s.inertia == pytest.approx(2048.7758751183, abs=1e-10)
    assert s.torsion == pytest.approx(4097.5517502366, abs=1e-10)
    assert s.arm == pytest.approx(4.5030327236, abs=1e-10)


@pytest.mark.parametrize(
    ("kind", "bar", "pa", "stretch"),
    [
        (0, 0.5, 52688.8125, 0.2247461293),
        (0, 1.0, 42191.0, 0.5613333019),
        (0, 1.5, 38106.3125, 0.9322555156),
        (1, 0.5, 55417.9375, 0.2136782277),
        (1, 1.0, 43277.0, 0.5472471137),
        (1, 1.5, 39702.9375, 0.8947655323),
    ],
)
def test_modulus_and_stretch(kind: int, bar: float, pa: float, stretch: float) -> None:
    s = section(kind)
    assert s.modulus(bar)[0] * 1e6 == pytest.approx(pa, abs=1e-9)
    assert s.inflated(np.full(3, bar)).strain == pytest.approx(stretch, abs=1e-10)


def test_modulus_is_flat_beyond_its_clamp() -> None:
    s = section(1)
    assert s.modulus(2.5) == (s.modulus(1.9)[0], 0.0)
    assert s.modulus(1.0)[1] == pytest.approx((s.modulus(1.0001)[0] - s.modulus(0.9999)[0]) / 2e-4, rel=1e-6)


@pytest.mark.parametrize("case", FK, ids=[case["name"] for case in FK])
def test_golden_forward(case: dict[str, Any]) -> None:
    rod = rod_of(case)
    pressures, loads = np.array(case["P"], float), loads_of(case, len(rod.sections))
    coarse = standing(rod, pressures, loads)
    assert coarse.carried == 1.0
    assert np.abs(coarse.tip - case["tip"]).max() < 0.03
    fine = standing(rod, pressures, loads, 128)
    assert fine.carried == 1.0
    assert np.abs(fine.tip - case["tip"]).max() < 3e-8  # balance is met to 1e-9 N·mm
    assert np.abs(fine.ends[0] - case["mid"]).max() < 3e-8
    assert np.abs(fine.rotation.ravel() - case["R"]).max() < 1e-9
    wall = fine.moment + rod.sections[0].pair_moment @ pressures[:3]
    assert np.abs(wall - case["m0"]).max() < 1e-8


def test_fourth_order() -> None:
    loads = hanging(10.0)
    p = np.array([0.3, 0.9, 0.1, 0.6, 0.0, 0.7])
    rod = two()
    exact = standing(rod, p, loads, 96).tip
    errors = [np.linalg.norm(standing(rod, p, loads, n).tip - exact) for n in (4, 8, 16)]
    assert errors[0] / errors[1] > 12.0
    assert errors[1] / errors[2] > 12.0


@pytest.mark.parametrize(
    ("alpha", "w", "u", "theta"),
    [
        (1.0, 0.3017207738, 0.0564332363, 0.4613519497),
        (2.0, 0.4934574804, 0.1606417208, 0.7817498316),
        (5.0, 0.7137915236, 0.3876283607, 1.2153681176),
        (10.0, 0.8106090249, 0.5549955978, 1.4302855388),
    ],
)
def test_elastica(alpha: float, w: float, u: float, theta: float) -> None:
    """Euler's elastica under a transverse end force: inextensible by an area 1e7 times too large."""
    real = section(0)
    modulus = (0.0, 0.0, 0.0, 0.0, 76130.0)
    rod = Rod(
        (
            Section(
                42.0, 0.0, real.area * 1e7, real.inertia, real.torsion, real.chamber_area, real.arm, modulus
            ),
        )
    )
    force = alpha * 76130e-6 * real.inertia / 42.0**2
    loads = Loads(tip_force=np.array([force, 0.0, 0.0]))
    found = standing(rod, np.zeros(3), loads, 64)
    assert found.carried == 1.0
    assert found.tip[0] / 42.0 == pytest.approx(w, abs=1e-6)
    assert 1.0 - found.tip[2] / 42.0 == pytest.approx(u, abs=1e-6)
    tangent = found.rotation[:, 2]
    assert np.arctan2(tangent[0], tangent[2]) == pytest.approx(theta, abs=1e-6)


def _general() -> Loads:
    return loads_of(next(case for case in FK if case["name"].startswith("two general")), 2)


def test_tangents_are_derivatives() -> None:
    """Every column of NumPy's sweep against central differences, with weights and a rigid tip."""
    rod, elements = two(tip_link=3.0), 12
    general = _general()
    loads = Loads(general.tip_force, weight=general.weight, link_weight=general.link_weight)
    assert loads.weight
    assert loads.link_weight
    p, m = np.array([0.3, 0.9, 0.1, 0.6, 0.2, 0.7]), np.array([0.4, -0.2, 0.1])

    def all_rows(unknown: Array) -> Array:
        s = sweep(rod, unknown[3:], unknown[:3], loads, elements)
        return np.concatenate([s.moment, s.tip])

    here = sweep(rod, p, m, loads, elements)
    analytic = np.vstack([here.moment_by, here.tip_by])
    unknown, step = np.concatenate([m, p]), 1e-5
    for column in range(9):
        shift = np.zeros(9)
        shift[column] = step
        difference = (all_rows(unknown + shift) - all_rows(unknown - shift)) / (2.0 * step)
        assert np.abs(difference - analytic[:, column]).max() < 2e-4 * (1.0 + np.abs(difference).max())


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(0.0, 1.5), min_size=6, max_size=6), st.floats(0.0, 6.28))
def test_turning_the_arm_turns_everything(pressures: list[float], angle: float) -> None:
    """Rotating pairs and load about z by the same angle rotates tip and mid-point by it."""
    c, s = np.cos(angle), np.sin(angle)
    about_z = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    force = np.array([0.004, -0.002, 0.03])
    p = np.array(pressures)
    turned = Rod((section(0, 5.0, first_pair_rad=angle), section(1, first_pair_rad=angle)))
    a = standing(two(), p, Loads(tip_force=force))
    b = standing(turned, p, Loads(tip_force=about_z @ force))
    assert a.carried == b.carried == 1.0
    assert np.abs(about_z @ a.tip - b.tip).max() < 1e-6


@given(st.floats(1e-4, 3.0))
@settings(max_examples=30, deadline=None)
def test_screw_motions_compose(angle: float) -> None:
    u, v = angle * np.array([0.6, -0.64, 0.48]), np.array([1.0, 2.0, -0.5])
    whole_R, whole_p = exp_se3(u, v)
    half_R, half_p = exp_se3(0.5 * u, 0.5 * v)
    assert np.abs(half_R @ half_R - whole_R).max() < 1e-14
    assert np.abs(half_p + half_R @ half_p - whole_p).max() < 1e-14


def test_backbone_ends_at_the_tip() -> None:
    rod, p, loads = two(tip_link=3.0), np.array([0.3, 0.9, 0.1, 0.6, 0.0, 0.7]), _general()
    at = rod.stations(36)
    assert at.tolist() == pytest.approx(
        [*np.linspace(0.0, 42.0, 37), 47.0, *np.linspace(47.0, 89.0, 37)[1:], 92.0], abs=1e-12
    )
    frames = np.empty((len(at), 12))
    solver(rod).statics(p.tolist(), loads, at, frames)
    line = frames[:, :3]
    assert np.abs(line[-1] - standing(rod, p, loads).tip).max() < 1e-12
    assert np.abs(line[0]).max() == 0.0
    assert np.max(np.linalg.norm(np.diff(line, axis=0), axis=1)) < 5.5


def test_single_section_is_the_first_of_two() -> None:
    """The mid-point of an unloaded arm is independent of what follows."""
    p = np.array([0.3, 0.9, 0.1, 0.6, 0.0, 0.7])
    alone = standing(one(), p[:3], Loads()).tip
    assert np.abs(standing(two(), p, Loads()).ends[0] - alone).max() < 1e-12
