"""The rod of tendon robots against its energy: an equilibrium is where the energy is stationary.

The energy is that of springs, weights and a force, over elements placed by matrix exponentials; its gradient
is by complex steps. The kernel sums virtual work instead, with twists of its own.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from contid.kernels import load
from contid.kinematics.tendon.geometry import TendonGeometry, TendonSection
from contid_tendons.rod import TendonRod
from tests.oracles.tendon_energy import Energy


def rods(elements: int = 2) -> dict[str, TendonRod]:
    """One inextensible with rigid pieces and weight, a spring, one in sheaths."""
    sections = tuple(
        TendonSection(
            0.1, (0.008, 0.007, 0.009), tuple(math.radians(a + 40 * k) for a in (0, 120, 250)), rigid
        )
        for k, rigid in enumerate((0.0, 0.004, 0.002))
    )
    geometry = TendonGeometry(sections, True, 0.01, (0.002, -0.001, 0.005))
    sheaths = TendonGeometry(sections[:2], False)
    bending, torsion, none = (2.9e-3, 2.5e-3, 2.2e-3), (2.2e-3, 2.0e-3, 1.8e-3), (math.inf,) * 3
    weight = np.array([[0.3, 0.1, -0.8], [0.2, -0.1, -0.7], [0.1, 0.2, -0.5]])
    tendon, rest = tuple(20e3 + 1e3 * k for k in range(9)), tuple(1.2 + 0.1 * k for k in range(9))
    return {
        "weight": TendonRod(geometry, bending, torsion, none, tendon, rest, weight, elements),
        "spring": TendonRod(geometry, bending, torsion, (900.0,) * 3, tendon, rest, weight, elements),
        "sheaths": TendonRod(
            sheaths, bending[:2], torsion[:2], none[:2], tendon[:6], rest[:6], weight[:2], elements
        ),
    }


@pytest.mark.parametrize("name", ["weight", "spring", "sheaths"])
def test_equilibria_are_stationary_points_of_the_energy(name: str) -> None:
    rod, rng, met = rods(3)[name], np.random.default_rng(4), 0
    for _ in range(8):
        pulls = rng.uniform(-0.002, 0.006, rod.geometry.tendons)
        fx, fy, fz = rng.uniform(-0.15, 0.15, 3).tolist()
        try:
            found = rod.solve(pulls, (fx, fy, fz))
        except ArithmeticError:  # not every pull has an equilibrium next to the straight rod
            continue
        met += 1
        energy, x = Energy(rod, pulls, (fx, fy, fz)), found.strain.ravel()
        stiffest = float(rod.discrete.stiffness[:, 0].max())
        assert np.linalg.norm(energy.gradient(x)) <= 2e-7 * stiffest
        points, rotation, tip = energy.placed(x)
        np.testing.assert_allclose(found.points_m, points, atol=1e-13)
        np.testing.assert_allclose(found.rotation, rotation, atol=1e-12)
        np.testing.assert_allclose(found.tip_m, tip, atol=1e-13)
        np.testing.assert_allclose(found.tensions_n, energy.tensions(x), atol=1e-9)
        np.testing.assert_array_equal(found.ends_m, found.points_m[3::3])
        if not rod.discrete.stretches:
            assert not found.strain[:, 3].any()
    assert met >= 6


@pytest.mark.parametrize("name", ["weight", "spring", "sheaths"])
def test_derivatives_are_those_of_the_energy(name: str) -> None:
    """By the implicit function theorem: the gradient of the energy stays 0."""
    rod, rng = rods()[name], np.random.default_rng(5)
    pulls = rng.uniform(0.0, 0.004, rod.geometry.tendons)
    force = (0.08, -0.05, 0.1)
    found = rod.solve(pulls, force)
    energy, x = Energy(rod, pulls, force), found.strain.ravel()
    H, tip = energy.hessian(x), energy.tip_by_strain(x)
    by_pull = []
    for step in 1e-6 * np.eye(len(pulls)):
        up, down = (Energy(rod, pulls + sign * step, force).gradient(x) for sign in (1.0, -1.0))
        by_pull.append((up - down) / 2e-6)
    expected = -tip @ np.linalg.solve(H, np.transpose(by_pull))
    np.testing.assert_allclose(found.jacobian, expected, atol=2e-7 * np.abs(expected).max())
    compliance = tip @ np.linalg.solve(H, tip.T)
    np.testing.assert_allclose(found.compliance, compliance, atol=2e-7 * np.abs(compliance).max())


def test_a_slack_tendon_pulls_nothing_and_moves_nothing() -> None:
    rod = rods()["weight"]
    pulls = np.zeros(9)
    pulls[1] = -0.03
    found = rod.solve(pulls)
    assert found.tensions_n[1] == 0.0
    assert not found.jacobian[:, 1].any()
    assert found.tensions_n[2] > 0.0
    further = pulls.copy()
    further[1] -= 0.01
    np.testing.assert_array_equal(rod.solve(further).strain, found.strain)


def test_the_jacobian_is_that_of_differences() -> None:
    rod = rods(4)["spring"]
    pulls = np.array([3.0, -1.0, -1.5, 1.0, 2.0, -1.5, 0.5, 0.5, 1.5]) * 1e-3
    at = rod.solve(pulls, (0.05, -0.02, 0.1))
    for tendon in range(9):
        step = np.zeros(9)
        step[tendon] = 1e-7
        up, down = (rod.solve(pulls + sign * step, (0.05, -0.02, 0.1), at.strain) for sign in (1, -1))
        np.testing.assert_allclose(at.jacobian[:, tendon], (up.tip_m - down.tip_m) / 2e-7, atol=2e-4)


def test_the_start_does_not_matter_and_the_equilibrium_itself_stays() -> None:
    rod, pulls = rods(4)["spring"], np.linspace(-1e-3, 4e-3, 9)
    straight = rod.solve(pulls, (0.03, 0.0, 0.0))
    bent = rod.solve(pulls, (0.03, 0.0, 0.0), rod.even(np.array([0.6, -0.5, 0.4, 0.3, -0.2, 0.1])))
    np.testing.assert_allclose(bent.strain, straight.strain, atol=1e-9)
    again = rod.solve(pulls, (0.03, 0.0, 0.0), straight.strain)
    np.testing.assert_array_equal(again.strain, straight.strain)
    np.testing.assert_array_equal(again.tip_m, straight.tip_m)
    np.testing.assert_allclose(again.jacobian, straight.jacobian, rtol=1e-12)


def test_derivatives_can_be_left_out() -> None:
    rod, pulls = rods()["weight"], np.full(9, 1e-3)
    quick, full = rod.solve(pulls, derivatives=False), rod.solve(pulls)
    assert np.isnan(quick.jacobian).all()
    assert np.isnan(quick.compliance).all()
    np.testing.assert_array_equal(quick.strain, full.strain)
    np.testing.assert_array_equal(quick.tip_m, full.tip_m)


def test_both_builds_have_the_same_bits() -> None:
    """Where the processor has no AVX2 there is one build."""
    rod = rods(4)["weight"]
    pulls, into = np.linspace(0.0, 4e-3, 9), rod.solve(np.zeros(9))
    wide = rod.solve(pulls, (0.05, 0.0, 0.02))
    from contid.kernels import _tendon_rod  # type: ignore[attr-defined]  # compiled

    assert _tendon_rod.Rod(rod.discrete).solve(pulls, (0.05, 0.0, 0.02), np.zeros((12, 4)), into, True) == 1
    for field in ("strain", "points_m", "tip_m", "rotation", "tensions_n", "jacobian", "compliance"):
        np.testing.assert_array_equal(getattr(into, field), getattr(wide, field))


def test_a_load_beyond_the_robot_is_named() -> None:
    rod = rods()["weight"]
    with pytest.raises(ArithmeticError, match="no equilibrium"):
        rod.solve(np.zeros(9), (math.nan, 0.0, 0.0))
    with pytest.raises(ArithmeticError, match="no equilibrium"):
        rod.solve(np.full(9, math.nan))


def test_wrong_sizes_are_refused() -> None:
    rod = rods()["weight"]
    with pytest.raises(ValueError, match="size"):
        rod.solve(np.zeros(8))
    with pytest.raises(ValueError, match="size"):
        rod.solve(np.zeros(9), start=np.zeros((5, 4)))
    with pytest.raises(ValueError, match="force: three"):
        rod.solve(np.zeros(9), (0.0, 0.0))  # type: ignore[arg-type]  # that is the test

    class Changed:
        def __init__(self, name: str, value: object) -> None:
            self.name, self.value = name, value

        def __getattr__(self, name: str) -> object:
            return self.value if name == self.name else getattr(rod.discrete, name)

    kernel = load("tendon_rod")
    for name in ("rigid", "stiffness", "arms", "tendon", "weight", "offset"):
        with pytest.raises(ValueError, match=f"{name}: "):
            kernel.Rod(Changed(name, np.zeros(2)))
    for name in ("lengths", "rest"):
        with pytest.raises(ValueError, match="tendons"):
            kernel.Rod(Changed(name, np.zeros(0)))
    with pytest.raises(ValueError, match="1 to 64 tendons"):
        kernel.Rod(Changed("rest", np.zeros(65)))


@pytest.mark.parametrize("name", ["weight", "spring", "sheaths"])
def test_an_equilibrium_is_stable_where_the_energy_has_a_minimum(name: str) -> None:
    """A force along the straight rod bends it aside beyond its critical load."""
    rod, seen = rods()[name], set[bool]()
    for newtons in (0.5, -0.5, -5.0, -50.0, -500.0):
        for pulls in (np.zeros(rod.geometry.tendons), np.full(rod.geometry.tendons, 1e-3)):
            try:
                found = rod.solve(pulls, (0.0, 0.0, newtons))
            except ArithmeticError:
                continue
            hessian = Energy(rod, pulls, (0.0, 0.0, newtons)).hessian(found.strain.ravel())
            assert found.stable == (np.linalg.eigvalsh(0.5 * (hessian + hessian.T)).min() > 0.0)
            seen.add(found.stable)
    assert True in seen
