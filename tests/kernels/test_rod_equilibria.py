"""Equilibria of the rod's kernel against the differential equations and the energy's second variation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contid.kinematics.array import Array
from contid.kinematics.cosserat.engine import NearAnswer
from contid.kinematics.cosserat.section import Loads, Rod
from contid.targets import ZERO3, Vec3
from tests.kernels.rod_tasks import own_weight, rod_of
from tests.kinematics.cosserat_cases import GRAM, one, section, solver, standing, two
from tests.oracles.rod_energy import variation
from tests.oracles.rod_equations import equilibrium, integrate

#: A disagreement of places [mm] and of moments [N·mm] with 48 elements per section.
SAME_MM, SAME_NMM = 2e-4, 2e-5


def drawn(sections: int, seed: int) -> tuple[Array, Vec3]:
    """Random pressures [bar], and a force in any direction that the arm carries [N]."""
    rng = np.random.default_rng([seed, sections])
    x, y, z = (rng.normal(size=3) * 0.04 / sections**2).tolist()
    return rng.uniform(0.0, 1.5, 3 * sections), (x, y, z)


@pytest.mark.parametrize("weighs", [False, True])
@pytest.mark.parametrize("tip_link", [0.0, 3.0])
@pytest.mark.parametrize("sections", [1, 2, 3, 4])
def test_forward_ends_in_balance_by_the_equations(sections: int, tip_link: float, weighs: bool) -> None:
    rod = rod_of(sections, tip_link)
    engine = solver(rod, own_weight(sections) if weighs else None, elements=48)
    pressures, force = drawn(sections, 3)
    found = engine.forward(pressures.tolist(), force)
    assert found.stable
    assert found.elements == 48
    exact = integrate(rod, pressures, engine.setup.loads(force), np.array(found.base_moment_nmm))
    assert np.abs(exact.left).max() < SAME_NMM
    assert found.tip_mm == pytest.approx(exact.tip, abs=SAME_MM)
    assert found.mid_mm == pytest.approx(exact.ends[0], abs=SAME_MM)
    assert found.rotation == pytest.approx(exact.rotation.ravel(), abs=1e-5)


@pytest.mark.parametrize("seed", range(6))
def test_forward_is_stable_where_the_energy_has_a_minimum(seed: int) -> None:
    """Loads from none to ones that bend the arm far."""
    rng = np.random.default_rng(seed)
    rod, engine = two(), solver(two(), elements=24)
    pressures, force = rng.uniform(0.0, 1.5, 6), (0.01 * seed * rng.normal(size=3)).tolist()
    found = engine.forward(pressures.tolist(), (force[0], force[1], force[2]))
    loads = Loads(tip_force=np.array(force))
    moment = np.array(found.base_moment_nmm)
    assert np.abs(integrate(rod, pressures, loads, moment).left).max() < 1e-4
    varied = variation(rod, pressures, loads, moment)
    assert np.abs(varied.gradient).max() < 0.02 * max(1.0, float(np.linalg.norm(moment)))
    assert found.stable
    assert varied.unstable == 0


def test_a_buckled_arm_stands_in_some_equilibrium_under_the_whole_load() -> None:
    """Upright with twice what it carries: no branch leads there, but what is found is in balance."""
    engine, force = solver(two(), elements=12), (0.0, 0.0, -6.0 * GRAM)
    pressures = np.full(6, 0.5)
    found = engine.forward(pressures.tolist(), force)
    assert not found.stable
    assert found.elements == 48  # more elements were tried before
    loads = Loads(tip_force=np.array(force))
    exact = integrate(two(), pressures, loads, np.array(found.base_moment_nmm))
    assert np.abs(exact.left).max() < 1e-5
    assert found.tip_mm == pytest.approx(exact.tip, abs=SAME_MM)
    under = standing(two(), pressures, loads)
    critical = engine.critical((under.carried * pressures).tolist(), force, 1.0)
    assert critical == pytest.approx(under.carried, rel=0.01)
    assert under.elements == 48
    assert np.abs(integrate(two(), pressures, loads, under.moment).left).max() < 1e-5


def test_elements_are_doubled_as_far_as_the_error_asks() -> None:
    """The true error is below each bound, and half the elements of the answer were not enough for it."""
    pressures, force = np.array([1.4, 0.2, 0.0, 0.3, 0.7, 1.1]), (0.02, 0.01, 0.03)
    loads, counts = Loads(tip_force=np.array(force)), []
    start = np.array(solver(two(), elements=48).forward(pressures.tolist(), force).base_moment_nmm)
    moment = equilibrium(two(), pressures, loads, start)
    assert moment is not None
    exact = integrate(two(), pressures, loads, moment)

    def off(tip: Vec3, mid: Vec3) -> float:
        return max(math.dist(tip, exact.tip), math.dist(mid, exact.ends[0]))

    for error in (10.0, 0.1, 0.01, 1e-3, 1e-5):
        found = solver(two(), error=error).forward(pressures.tolist(), force)
        counts.append(found.elements)
        assert off(found.tip_mm, found.mid_mm) <= 1.5 * error
        if found.elements > 3:
            half = solver(two(), elements=found.elements // 2).forward(pressures.tolist(), force)
            assert off(half.tip_mm, half.mid_mm) > 0.3 * error
    assert counts == sorted(counts)
    assert counts[0] == 3
    assert counts[-1] >= 24
    assert solver(two(), error=0.0).forward(pressures.tolist(), force).elements == 48
    assert solver(two(), error=0.0).forward(pressures.tolist(), ZERO3).elements == 3  # exact without a load


@pytest.mark.parametrize(
    ("sections", "weighs"),
    [
        *((1, True), (2, False), (3, True)),
        *(pytest.param(*each, marks=pytest.mark.campaign) for each in ((1, False), (2, True), (3, False))),
    ],
)
def test_a_near_equilibrium_and_its_derivatives(sections: int, weighs: bool) -> None:
    """By differentiation of the equations: dM/dx = -(dm/dM)^-1 dm/dx of the moment m left at the tip."""
    rod, engine = (
        rod_of(sections),
        solver(rod_of(sections), own_weight(sections) if weighs else None, elements=32),
    )
    pressures, force = drawn(sections, 11)
    at = engine.forward(pressures.tolist(), force)
    assert at.stable
    near = engine.near(pressures.tolist(), force, [value + 1e-3 for value in at.base_moment_nmm])
    assert near is not None
    assert near.tip_mm == pytest.approx(at.tip_mm, abs=1e-6)
    assert near.base_moment_nmm == pytest.approx(at.base_moment_nmm, abs=1e-7)
    moment, n, h = np.array(at.base_moment_nmm), 3 * sections, 1e-4

    def ends(x: Array) -> Array:
        acting = engine.setup.loads((x[3], x[4], x[5]))
        found = integrate(rod, x[6:], acting, x[:3])
        return np.concatenate([found.left, found.tip])

    x = np.concatenate([moment, force, pressures])
    steps = h * np.diag([1.0] * 3 + [0.01] * 3 + [1.0] * n)
    by = np.stack([(ends(x + d) - ends(x - d)) / (2.0 * float(d.sum())) for d in steps], axis=1)
    held = np.linalg.solve(by[:3, :3], by[:3, 3:])
    exact = by[3:, 3:] - by[3:, :3] @ held
    by_force = np.array(near.by_force_mm_n).reshape(3, 3)
    by_pressure = np.array(near.by_pressure_mm_bar).reshape(3, n)
    assert np.abs(by_force - exact[:, :3]).max() < 1e-4 * np.abs(by_force).max()
    assert np.abs(by_pressure - exact[:, 3:]).max() < 1e-4 * np.abs(by_pressure).max()
    assert np.abs(by_force - by_force.T).max() < 1e-4 * np.abs(by_force).max()
    assert np.linalg.eigvalsh(by_force + by_force.T).min() > 0.0


def test_near_takes_only_what_contracts_to_a_stable_equilibrium() -> None:
    engine, p = solver(two()), [0.3, 0.5, 0.1, 0.2, 0.6, 0.4]
    assert engine.near(p, (0.0, 0.0, 0.05), (1e4, -1e4, 1e4)) is None
    load = (0.0, 0.0, 5.0 * GRAM)
    moment = np.array(engine.forward(p, load).base_moment_nmm)
    reached = [
        engine.near(p, load, (moment + off * np.array([1.0, -0.5, 0.2])).tolist()) for off in (0.0, 0.3, 50.0)
    ]
    same: list[NearAnswer] = [each for each in reached[:2] if each is not None]
    assert len(same) == 2
    assert same[0].base_moment_nmm == pytest.approx(moment, abs=1e-9)
    assert same[1].base_moment_nmm == pytest.approx(moment, abs=1e-7)
    assert reached[2] is None
    # The straight arm upright: the same equilibrium is stable, or not, by the load alone.
    straight = solver(one(), elements=12)
    assert straight.near([0.0] * 3, (0.0, 0.0, -21.0 * GRAM), ZERO3) is not None
    assert straight.near([0.0] * 3, (0.0, 0.0, -21.6 * GRAM), ZERO3) is None


#: Pressures [bar], and forces [N] under which the arm snaps after the pressures are there in full.
SNAPPING: list[tuple[tuple[float, ...], Vec3]] = [
    ((0.761, 0.157, 1.14, 1.234, 0.724, 0.582), (0.0731, -0.1361, 0.0059)),
    ((0.913, 0.912, 0.023, 1.373, 0.446, 1.338), (0.1535, 0.1024, -0.0804)),
    ((0.543, 0.961, 0.782, 0.121, 0.036, 1.464), (-0.1462, -0.0483, -0.1573)),
    ((0.355, 1.244, 1.182, 0.76, 0.232, 1.127), (-0.1188, -0.0369, 0.0025)),
]


@pytest.mark.parametrize(
    ("bar", "force"),
    [*SNAPPING[:2], *(pytest.param(*each, marks=pytest.mark.campaign) for each in SNAPPING[2:])],
)
def test_at_a_critical_factor_the_energy_loses_its_minimum(bar: tuple[float, ...], force: Vec3) -> None:
    """Walked in small steps of the force: the least curvature of the energy goes to zero there."""
    engine = solver(two())
    factor = engine.critical(bar, force, 1.0)
    assert factor is not None
    moment, least, fine = engine.forward(bar, ZERO3).base_moment_nmm, [], solver(two(), elements=24)
    shares = np.concatenate([np.linspace(0.0, 0.9, 100), np.linspace(0.9, 0.99, 61)[1:], [1.012]])
    for share in (factor * shares).tolist():
        part = (share * force[0], share * force[1], share * force[2])
        near = fine.near(bar, part, moment)
        if share > factor:
            assert near is None
            break
        assert near is not None
        moment = near.base_moment_nmm
        if share in (0.9 * factor, 0.99 * factor):
            varied = variation(two(), np.array(bar), Loads(tip_force=np.array(part)), np.array(moment))
            least.append(float(np.linalg.eigvalsh(varied.hessian)[0]))
    assert 0.0 < least[1] < 0.45 * least[0], least
    # The same load by another factor; and both sides of the upper end of the search.
    third = (force[0] / 3.0, force[1] / 3.0, force[2] / 3.0)
    assert engine.critical(bar, third, 3.0) == pytest.approx(3.0 * factor, rel=1e-3)
    assert engine.critical(bar, force, 0.985 * factor) is None
    assert engine.critical(bar, force, 1.015 * factor) == pytest.approx(factor, rel=0.01)


def test_a_heavy_arm_buckles_by_itself() -> None:
    heavy = Loads(weight={0: np.array([0.0, 0.0, -0.02])})
    assert solver(one(), heavy).critical([0.5] * 3, (0.0, 0.0, 0.001), 1.0) == 0.0
    hanging = Loads(weight={0: np.array([0.0, 0.0, 0.02])})
    assert solver(one(), hanging).critical([0.5] * 3, (0.0, 0.0, 0.001), 1.0) is None
    # Greenhill: an upright column of constant section buckles by its own weight at q L^3 = 7.8373 E I.
    bar = section(0)
    stiffness = 76130e-6 * bar.inertia
    rigid = Rod((section(0).cut(42.0),))
    for part, buckles in ((0.9, False), (1.0, True)):
        q = part * 7.8373 * stiffness / 42.0**3
        found = solver(rigid, Loads(weight={0: np.array([0.0, 0.0, -q])})).forward([0.0] * 3, ZERO3)
        assert found.stable != buckles


@pytest.mark.parametrize("seed", range(3))
def test_frames_along_the_arm_are_those_of_the_equations(seed: int) -> None:
    """Every kind of load, two sections with links, stations at every joint and twice at one place."""
    rng, rod = np.random.default_rng(seed), rod_of(2)
    loads = Loads(
        rng.uniform(-0.03, 0.03, 3), rng.uniform(-2.0, 2.0, 3),
        {0: rng.uniform(-0.03, 0.03, 3), 1: rng.uniform(-0.02, 0.02, 3)},
        {0: rng.uniform(-2.0, 2.0, 3), 1: rng.uniform(-1.0, 1.0, 3)}, {1: rng.uniform(-1e-3, 1e-3, 3)},
        {0: rng.uniform(-1e-3, 1e-3, 3), 1: rng.uniform(-1e-3, 1e-3, 3)},
    )  # fmt: skip
    pressures = rng.uniform(0.0, 1.2, 6)
    at = np.array([0.0, 0.4, 17.0, 17.0, 42.0, 44.0, 47.0, 88.9, 89.0, 90.0, 92.0, 92.0])
    frames = np.empty((len(at), 12))
    found = solver(rod, elements=48).statics(pressures.tolist(), loads, at, frames)
    assert found.carried == 1.0
    exact = integrate(rod, pressures, loads, np.array(found.base_moment_nmm), at)
    assert np.abs(exact.left).max() < SAME_NMM
    np.testing.assert_allclose(frames[:, :3], exact.frames[:, :3], rtol=0.0, atol=SAME_MM)
    np.testing.assert_allclose(frames[:, 3:], exact.frames[:, 3:], rtol=0.0, atol=1e-5)
    # With few elements the stations do not disturb the sweep: the tip is that without them.
    alone = standing(rod, pressures, loads)
    np.testing.assert_allclose(alone.tip, frames[-1, :3], rtol=0.0, atol=0.1)


def test_a_force_on_a_joint_is_carried_in_part() -> None:
    """A column with a force on the end of its first section buckles as one of that length."""
    rod = Rod((section(0), section(0)))
    alone = solver(one()).critical([0.0] * 3, (0.0, 0.0, -30.0 * GRAM), 1.0)
    assert alone is not None
    for part, whole in ((0.97, True), (1.04, False)):
        force = np.array([0.0, 0.0, -30.0 * GRAM * alone * part])
        found = standing(rod, np.zeros(6), Loads(joint_force={0: force}), 6)
        assert (found.carried == 1.0) == whole


def test_moments_have_no_energy_and_are_followed_all_the_same() -> None:
    """A dead moment that bends the straight arm past a full turn, as an arc: its radius is E I / M."""
    stiffness = 76130e-6 * section(0).inertia
    for turns in (0.25, 0.9, 1.2):
        moment = np.array([0.0, stiffness * 2.0 * math.pi * turns / 42.0, 0.0])
        found = standing(one(), np.zeros(3), Loads(tip_moment=moment), 16)
        assert found.carried == 1.0
        assert found.moment == pytest.approx(moment, abs=1e-9)
        radius, angle = 42.0 / (2.0 * math.pi * turns), 2.0 * math.pi * turns
        expected = [radius * (1.0 - math.cos(angle)), 0.0, radius * math.sin(angle)]
        assert found.tip == pytest.approx(expected, abs=1e-6)


def test_an_arm_may_have_eight_sections_and_no_more() -> None:
    assert solver(rod_of(8)).forward([0.0] * 24, ZERO3).tip_mm[2] == pytest.approx(8 * 42.0 + 7 * 5.0 + 3.0)
    for sections in (0, 9):
        with pytest.raises(ValueError, match="one to eight sections"):
            solver(Rod((section(0),) * sections))
