"""The native kernel against its specification in NumPy, to the last digits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contid.kernels import load
from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.section_model import build_solver
from contid.kinematics.arc.sections import Sections, differentiate, forward
from contid.kinematics.arc.solve import SectionSolver
from contid.kinematics.arc.solver import Solver
from contid.kinematics.arc.task import tuning_for
from tests.kinematics.section_robots import ROBOTS, random_lengths

pytestmark = pytest.mark.skipif(
    load("arc") is None, reason="the kernel is not built, or CONTID_PURE_PYTHON is set"
)


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


@settings(max_examples=150, deadline=None)
@given(chains(), st.randoms(use_true_random=False), st.booleans())
def test_frames_and_jacobians(feasible, random, straight):
    lengths = np.array([random.uniform(0.02, 0.3) for _ in feasible.low])
    if straight:
        lengths = np.repeat(lengths[::3], 3) + 1e-9 * lengths
    kernel = build_solver(feasible)
    tip, rotation, mid = kernel.forward(tuple(lengths.tolist()))
    expected = forward(feasible.sections, lengths)
    scale = lengths.sum()
    np.testing.assert_allclose(tip, expected.tip, rtol=1e-12, atol=1e-12 * scale)
    np.testing.assert_allclose(np.reshape(rotation, (3, 3)), expected.rotation, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(mid, expected.mid, rtol=1e-12, atol=1e-12 * scale)
    size = len(lengths)
    arrays = np.full((3, 3, size), math.nan)
    kernel.differentiate(tuple(lengths.tolist()), *arrays)
    at = differentiate(feasible.sections, lengths)
    for got, exact in zip(arrays, (at.tip, at.spin, at.mid), strict=True):
        np.testing.assert_allclose(got, exact, rtol=1e-12, atol=1e-12 * np.abs(exact).max())


def both(name: str) -> tuple[Feasible, Solver, SectionSolver]:
    feasible = ROBOTS[name]()
    return feasible, build_solver(feasible), SectionSolver(feasible, tuning_for(feasible))


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("mode", ["tip", "direction", "mid"])
def test_the_solver_takes_the_same_steps(name, mode):
    feasible, kernel, twin = both(name)
    if feasible.sections.count == 1 and mode != "tip":
        pytest.skip("one section has no lengths left for it")
    seeds = random_lengths(feasible, 30, seed=5)
    for lengths, seed in zip(random_lengths(feasible, 30, seed=4), seeds, strict=True):
        at = forward(feasible.sections, lengths)
        direction = tuple(at.rotation[:, 2].tolist()) if mode == "direction" else None
        mid = tuple(at.mid.tolist()) if mode == "mid" else None
        goal = tuple(at.tip.tolist()), direction, mid, tuple(seed.tolist())
        ours, spec = kernel.solve(*goal), twin.solve(*goal)
        # Along a bend radius homing can end at its step budget, 1e-8 m short: rounding shows there.
        np.testing.assert_allclose(ours[0], spec[0], atol=1e-7)
        assert ours[2:] == spec[2:]


@pytest.mark.parametrize("name", ROBOTS)
def test_the_same_answers_out_of_reach(name):
    feasible, kernel, twin = both(name)
    rng = np.random.default_rng(6)
    for _ in range(6):
        away = rng.normal(size=3)
        tip = tuple((2.0 * sum(feasible.upper) * away / np.linalg.norm(away)).tolist())
        goal = tip, None, None, tuple(feasible.home.tolist())
        ours, spec = kernel.solve(*goal), twin.solve(*goal)
        assert ours[1] == pytest.approx(spec[1], abs=1e-9)
        assert ours[2:4] == spec[2:4]


def test_wrong_arguments_are_refused():
    feasible, kernel, _ = both("cbha")
    home = tuple(feasible.home.tolist())
    with pytest.raises(ValueError, match="three lengths"):
        kernel.forward(home[:5])
    with pytest.raises(ValueError, match="tip"):
        kernel.solve((0.0, 0.0), None, None, home)  # type: ignore[arg-type]  # that is the test
    with pytest.raises(TypeError):
        kernel.solve(("a", 0.0, 0.0), None, None, home)  # type: ignore[arg-type]  # that is the test
