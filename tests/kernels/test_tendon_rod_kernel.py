"""The native rod of tendon robots against its specification in NumPy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contid.kernels import load
from contid.kinematics.tendon import rod_twin
from contid.kinematics.tendon.geometry import TendonGeometry, TendonSection
from contid.kinematics.tendon.rod import TendonRod

pytestmark = pytest.mark.skipif(
    load("tendon_rod") is None, reason="the kernel is not built, or CONTID_PURE_PYTHON is set"
)


def rods() -> dict[str, TendonRod]:
    """One inextensible with rigid pieces and weight, a spring, one in sheaths."""
    sections = tuple(
        TendonSection(
            0.1, (0.008, 0.007, 0.009), tuple(math.radians(a + 40 * k) for a in (0, 120, 250)), rigid
        )
        for k, rigid in enumerate((0.0, 0.004, 0.002))
    )
    geometry = TendonGeometry(sections, True, 0.01, (0.002, -0.001, 0.005))
    sheaths = TendonGeometry(sections[:2], False)
    bending, torsion, none = (2.9e-3,) * 3, (2.2e-3,) * 3, (math.inf,) * 3
    weight = np.array([[0.3, 0.1, -0.8]] * 3)
    tendon, rest = (20e3,) * 9, (1.2,) * 9
    return {
        "weight": TendonRod(geometry, bending, torsion, none, tendon, rest, weight, elements=5),
        "spring": TendonRod(geometry, bending, torsion, (900.0,) * 3, tendon, rest, weight, elements=4),
        "sheaths": TendonRod(
            sheaths, bending[:2], torsion[:2], none[:2], tendon[:6], rest[:6], weight[:2], elements=6
        ),
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", ["weight", "spring", "sheaths"])
def test_the_same_equilibria(name: str) -> None:
    rod, rng = rods()[name], np.random.default_rng(4)
    tendons, met = rod.geometry.tendons, 0
    for _ in range(6):
        pulls = rng.uniform(-0.002, 0.006, tendons)
        x, y, z = rng.uniform(-0.15, 0.15, 3).tolist()
        try:
            spec = rod_twin.solve(rod.discrete, pulls, (x, y, z), None)
        except ArithmeticError:
            with pytest.raises(ArithmeticError):
                rod.solve(pulls, (x, y, z))
            continue
        met += 1
        ours = rod.solve(pulls, (x, y, z))
        np.testing.assert_allclose(ours.strain, spec.strain, atol=1e-8)
        for field in ("points_m", "tip_m", "rotation", "ends_m", "tensions_n"):
            np.testing.assert_allclose(getattr(ours, field), getattr(spec, field), atol=1e-6, rtol=1e-7)
        np.testing.assert_allclose(ours.jacobian, spec.jacobian, atol=1e-6 * np.max(abs(spec.jacobian)))
        np.testing.assert_allclose(ours.compliance, spec.compliance, atol=1e-6 * np.max(abs(spec.compliance)))
    assert met >= 4


def test_the_jacobian_is_that_of_differences() -> None:
    rod = rods()["spring"]
    pulls = np.array([3.0, -1.0, -1.5, 1.0, 2.0, -1.5, 0.5, 0.5, 1.5]) * 1e-3
    at = rod.solve(pulls, (0.05, -0.02, 0.1))
    for tendon in range(9):
        step = np.zeros(9)
        step[tendon] = 1e-7
        up, down = (rod.solve(pulls + sign * step, (0.05, -0.02, 0.1), at.strain) for sign in (1, -1))
        np.testing.assert_allclose(at.jacobian[:, tendon], (up.tip_m - down.tip_m) / 2e-7, atol=2e-4)


def test_a_load_beyond_the_robot_is_named() -> None:
    rod = rods()["weight"]
    with pytest.raises(ArithmeticError, match="no equilibrium"):
        rod.solve(np.zeros(9), (math.nan, 0.0, 0.0))


def test_wrong_sizes_are_refused() -> None:
    rod = rods()["weight"]
    with pytest.raises(ValueError, match="size"):
        rod.solve(np.zeros(8))
