"""The kernel of arcs: frames against matrix exponentials, builds, bits, arguments that are refused."""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contid.kernels import has_avx2, load
from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.section_model import build_solver
from contid.kinematics.arc.sections import Sections
from contid.kinematics.arc.solver import tuning_for
from tests.kernels.arc_cases import ARMS, solved, target_of
from tests.kinematics.section_robots import RACKS, random_lengths
from tests.oracles import twists


@st.composite
def chains(draw: st.DrawFn) -> Feasible:
    """One to eight sections with any radii, azimuths and rigid pieces."""
    count = draw(st.integers(1, 8))

    def each(low: float, high: float) -> tuple[float, ...]:
        return tuple(draw(st.floats(low, high)) for _ in range(count))

    phi, gap1, gap2 = draw(st.floats(-6.0, 6.0)), draw(st.floats(1.0, 2.5)), draw(st.floats(1.0, 2.5))
    angles = (phi, phi + gap1, phi + gap1 + gap2)
    sections = Sections(each(0.01, 0.08), (angles,) * count, each(0.0, 0.1))
    lower = each(0.02, 0.2)
    return Feasible(sections, lower, tuple(low + 0.1 for low in lower))


@settings(max_examples=80, deadline=None)
@given(chains(), st.randoms(use_true_random=False), st.booleans())
def test_frames_and_jacobians_are_those_of_exponentials(feasible, random, straight):
    lengths = np.array([random.uniform(0.02, 0.3) for _ in feasible.low])
    if straight:
        lengths = np.repeat(lengths[::3], 3) + 1e-9 * lengths
    kernel, chain = build_solver(feasible), twists.of_tubes(feasible.sections)
    found, expected = kernel.forward(tuple(lengths.tolist())), chain.placed(lengths)
    # The bend of a thin section is many turns, and has the rounding of the differences it is made of.
    bend = float(np.abs(feasible.sections.to_arc).sum() * lengths.max())
    scale = float(lengths.sum()) * max(1.0, bend / 10.0)
    np.testing.assert_allclose(found.tip, expected.tip, atol=1e-12 * scale)
    np.testing.assert_allclose(np.reshape(found.rotation, (3, 3)), expected.rotation, atol=1e-11)
    np.testing.assert_allclose(found.mid, expected.mid, atol=1e-12 * scale)
    arrays = np.full((3, 3, len(lengths)), math.nan)
    kernel.differentiate(tuple(lengths.tolist()), *arrays)
    for got, exact in zip(arrays, chain.jacobians(lengths), strict=True):
        np.testing.assert_allclose(got, exact, atol=1e-10 * max(1.0, float(np.abs(exact).max())))


def test_frames_beside_the_switch_to_the_series():
    """The series serves below q = theta^2 = 0.5; both sides of it, and small bends of any azimuth."""
    feasible = ARMS["tri-rack"]()
    kernel, chain = build_solver(feasible), twists.of_tubes(feasible.sections)
    for theta in (
        0.0,
        1e-9,
        1e-4,
        0.1,
        0.7,
        math.sqrt(0.5) - 1e-9,
        math.sqrt(0.5) + 1e-9,
        0.8,
        2.0,
        4.0,
        6.1,
    ):
        for phi in (0.0, 0.4, 2.0, -2.9):
            lengths = 0.3 - 0.035 * theta * np.cos(phi - np.array(RACKS))
            found, expected = kernel.forward(tuple(lengths.tolist())), chain.placed(lengths)
            np.testing.assert_allclose(found.tip, expected.tip, atol=1e-14)
            arrays = np.empty((3, 3, 3))
            kernel.differentiate(tuple(lengths.tolist()), *arrays)
            for got, exact in zip(arrays, chain.jacobians(lengths), strict=True):
                np.testing.assert_allclose(got, exact, atol=2e-13 * max(1.0, float(np.abs(exact).max())))


@pytest.mark.parametrize("name", ARMS)
def test_the_same_call_has_the_same_bits(name):
    feasible = ARMS[name]()
    one, other = build_solver(feasible), build_solver(feasible)
    for lengths in random_lengths(feasible, 10, seed=15):
        target = target_of(feasible, lengths, "tip")
        assert solved(one, target, feasible.home) == solved(other, target, feasible.home)
        assert solved(one, target, feasible.home) == solved(one, target, feasible.home)


@pytest.mark.skipif(not has_avx2(), reason="this processor has no AVX2")
def test_every_build_answers_alike():
    """The builds for one and two sections, for AVX2, against the one for any number: the same bits."""
    plain, wide = (importlib.import_module(f"contid.kernels.{name}") for name in ("_arc", "_arc_avx2"))
    assert load("arc") is wide
    for name in ("tri-rack", "cbha", "tri-rack 2"):
        feasible = ARMS[name]()
        sections = feasible.sections
        given_to = (
            sections.radius_m, sections.to_arc.ravel().tolist(), sections.to_lengths.ravel().tolist(),
            sections.rigid_m, feasible.lower, feasible.upper, feasible.home.tolist(), feasible.rack_m,
            feasible.curvature_max, tuning_for(feasible),
        )  # fmt: skip
        general, exact = plain.SectionSolver(*given_to), wide.SectionSolver(*given_to)
        for lengths in random_lengths(feasible, 30, seed=16):
            target = target_of(feasible, lengths, "tip")
            assert solved(general, target, feasible.home) == solved(exact, target, feasible.home)


def test_a_path_in_the_kernel_is_that_of_single_calls():
    feasible = ARMS["cbha"]()
    solver: Any = build_solver(feasible)
    tips = np.array(
        [solver.forward(tuple(row)).tip for row in random_lengths(feasible, 20, seed=18).tolist()]
    )
    out = np.empty((20, 6))
    assert solver.follow(tips, tuple(feasible.home.tolist()), out) == 20
    seed = tuple(feasible.home.tolist())
    for tip, row in zip(tips.tolist(), out.tolist(), strict=True):
        seed = solver.solve(tuple(tip), None, None, seed).lengths
        assert tuple(row) == seed
    for tips_, lengths in ((np.empty((2, 2)), np.empty((2, 6))), (np.empty((2, 3)), np.empty((3, 6)))):
        with pytest.raises(ValueError, match="points"):
            solver.follow(tips_, seed, lengths)
    with pytest.raises(ValueError, match="points"):
        solver.follow(np.empty((2, 3)), seed, np.empty((2, 5)))
    with pytest.raises(ValueError, match="three lengths"):
        solver.follow(np.empty((2, 3)), seed[:5], np.empty((2, 6)))


FRAME = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def test_wrong_arguments_are_refused():
    feasible = ARMS["cbha"]()
    kernel: Any = build_solver(feasible)
    home = tuple(feasible.home.tolist())
    wrong: list[tuple[tuple[Any, ...], str]] = [
        (((0.0, 0.0), None, None, home), "tip: three"),
        (((0.0, 0.0, 0.2), (0.0, 1.0), None, home), "direction: three"),
        (((0.0, 0.0, 0.2), None, (0.0,), home), "mid: three"),
        (((0.0, 0.0, 0.2), None, None, home[:5]), "seed: three lengths"),
        (((0.0, 0.0, 0.2), None, None, home, (1.0,) * 8), "rotation: nine"),
        (((0.0, 0.0, 0.2), (0.0, 0.0, 1.0), (0.0, 0.0, 0.1), home, FRAME), "instead of a direction"),
    ]
    for arguments, message in wrong:
        with pytest.raises(ValueError, match=message):
            kernel.solve(*arguments)
    with pytest.raises(TypeError):
        kernel.solve(("a", 0.0, 0.0), None, None, home)
    with pytest.raises(ValueError, match="three lengths"):
        kernel.forward(home[:5])
    fits = np.empty((3, 3, 6))
    with pytest.raises(ValueError, match="three lengths"):
        kernel.differentiate(home[:5], *fits)
    for place, name in enumerate(("tip", "spin", "mid")):
        for shape in ((3, 5), (2, 6), (18,)):
            arrays: list[np.ndarray] = [*fits]
            arrays[place] = np.empty(shape)
            with pytest.raises(ValueError, match=f"{name}: an array"):
                kernel.differentiate(home, *arrays)
    with pytest.raises(ValueError, match="seventeen"):
        kernel.avoid([(0.0,) * 16], 0.04, 0.005, 0.0, 0.02, 0.05)


def test_wrong_geometry_is_refused():
    feasible = ARMS["cbha"]()
    sections = feasible.sections
    given_to: dict[str, Any] = {
        "radius": sections.radius_m,
        "to_arc": sections.to_arc.ravel().tolist(),
        "to_lengths": sections.to_lengths.ravel().tolist(),
        "rigid": sections.rigid_m,
        "lower": feasible.lower,
        "upper": feasible.upper,
        "home": feasible.home.tolist(),
        "rack": feasible.rack_m,
        "curvature_max": feasible.curvature_max,
        "tuning": tuning_for(feasible),
    }
    kernel = load("arc")
    assert kernel.SectionSolver(**given_to)
    for name in ("to_arc", "to_lengths", "rigid", "lower", "upper", "home"):
        with pytest.raises(ValueError, match=f"{name}: "):
            kernel.SectionSolver(**{**given_to, name: [*given_to[name], 0.0]})
    for count in (0, 9):
        with pytest.raises(ValueError, match="one to eight"):
            kernel.SectionSolver(**{**given_to, "radius": (0.03,) * count})
    with pytest.raises(AttributeError):
        kernel.SectionSolver(**{**given_to, "tuning": object()})


@pytest.mark.parametrize("name", ARMS)
def test_targets_that_are_no_numbers_leave_the_seed(name):
    feasible = ARMS[name]()
    solver = build_solver(feasible)
    for tip in ((math.nan, 0.0, 0.2), (math.inf, 0.0, 0.0), (0.0, 1e7, 0.0)):
        answer = solver.solve(tip, None, None, tuple((feasible.home + 1e-3).tolist()))
        assert not answer.converged
        assert answer.starts == 0
        assert answer.lengths == pytest.approx(feasible.home + 1e-3, abs=1e-15)
