"""The solver of bends: frames against matrix exponentials, answers against the conditions of an optimum.

Of the bends that meet a target an answer has the least square; where nothing meets it, the answer is a least
error on the limits. See `tests.kernels.test_arc_answers`.
"""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np
import pytest

from contid.kernels import has_avx2, load
from contid.kinematics.arc.solver import SectionSolution, Tuning
from contid.kinematics.tendon.model import TendonModel
from tests.kinematics.tendon_robots import random_bends, shipped
from tests.oracles import section_limits, twists

ELL_M = 0.06
ROBOTS = pytest.mark.parametrize("name", ["tendon3", "ftdcr_v4"])
MODES = pytest.mark.parametrize("mode", ["tip", "direction", "mid", "rotation"])


def chain_of(model: TendonModel) -> twists.Chain:
    return twists.of_bends(model.feasible.sections)


def variables(model: TendonModel, count: int, seed: int) -> np.ndarray:
    """Bends inside every limit times the lengths of sections [m]."""
    lengths = np.repeat(model.feasible.sections.backbone_m, 2)
    return np.asarray(random_bends(model, count, seed) * lengths)


def target_of(model: TendonModel, x: np.ndarray, mode: str) -> dict[str, Any]:
    at = chain_of(model).placed(x)
    target: dict[str, Any] = {"tip": tuple(at.tip.tolist()), "direction": None, "mid": None, "rotation": None}
    if mode == "direction":
        target["direction"] = tuple(at.rotation[:, 2].tolist())
    elif mode == "mid":
        target["mid"] = tuple(at.mid.tolist())
    elif mode == "rotation":
        target["rotation"] = tuple(at.rotation.ravel().tolist())
    return target


def solved(solver: Any, target: dict[str, Any], seed: np.ndarray) -> SectionSolution:
    found: SectionSolution = solver.solve(
        target["tip"], target["direction"], target["mid"], tuple(seed.tolist()), target["rotation"]
    )
    return found


def ell_m(model: TendonModel) -> float:
    sections = model.feasible.sections
    return 0.2 * (sum(sections.backbone_m) + sum(sections.rigid_m))


@ROBOTS
def test_frames_and_jacobians_are_those_of_exponentials(name):
    model = shipped(name)
    size = 2 * model.feasible.sections.count
    for x in (*variables(model, 40, seed=1), np.zeros(size), np.full(size, 1e-9)):
        found, expected = model.solver.forward(tuple(x.tolist())), chain_of(model).placed(x)
        np.testing.assert_allclose(found.tip, expected.tip, atol=1e-14)
        np.testing.assert_allclose(np.reshape(found.rotation, (3, 3)), expected.rotation, atol=1e-13)
        np.testing.assert_allclose(found.mid, expected.mid, atol=1e-14)
        arrays = np.full((3, 3, size), math.nan)
        model.solver.differentiate(tuple(x.tolist()), *arrays)
        for got, exact in zip(arrays, chain_of(model).jacobians(x), strict=True):
            np.testing.assert_allclose(got, exact, atol=1e-12 * max(1.0, float(np.abs(exact).max())))


@ROBOTS
@MODES
def test_met_targets_are_met_inside_the_limits_with_the_least_bends(name, mode):
    model = shipped(name)
    limits, size = section_limits.of_bends(model.feasible), 2 * model.feasible.sections.count
    seeds, settled = variables(model, 15, seed=5), 0
    free = size > {"tip": 3, "direction": 5}.get(mode, 6)
    for x, seed in zip(variables(model, 15, seed=4), seeds, strict=True):
        target = target_of(model, x, mode)
        answer = solved(model.solver, target, seed)
        found = np.array(answer.lengths)
        error, J = twists.task(chain_of(model), ell_m(model), found, **target)
        assert answer.converged
        assert answer.residual_m == pytest.approx(np.linalg.norm(error), abs=1e-11)
        over = section_limits.excess(limits, found)
        assert over.max() <= 1e-11
        near = over[np.abs(over + 1e-9) > 1e-12]
        assert answer.binding.bit_count() >= int((near > -1e-9).sum())
        assert all(over[k] > -1e-9 - 1e-12 for k in range(len(over)) if answer.binding >> k & 1)
        if free:
            left = twists.multipliers_left(0.5 * found, J, section_limits.binding_normals(limits, found))
            settled += left <= 1e-5 * max(1e-3, float(np.linalg.norm(found)))
        again = solved(model.solver, target, found)
        assert np.abs(np.subtract(again.lengths, answer.lengths)).max() <= 1e-8
    assert settled >= 13 or not free


@ROBOTS
@MODES
def test_what_is_not_met_is_a_least_error_on_the_limits(name, mode):
    model = shipped(name)
    limits, size = section_limits.of_bends(model.feasible), 2 * model.feasible.sections.count
    rng, lefts = np.random.default_rng(6), [0.0]
    for k, x in enumerate(variables(model, 8, seed=7)):
        target = target_of(model, x, mode)
        away = rng.normal(size=3)
        shift = (0.5 if k % 2 else 0.15) * away / np.linalg.norm(away)
        target["tip"] = tuple((np.array(target["tip"]) + shift).tolist())
        answer = solved(model.solver, target, np.zeros(size))
        found = np.array(answer.lengths)
        error, J = twists.task(chain_of(model), ell_m(model), found, **target)
        assert answer.residual_m == pytest.approx(np.linalg.norm(error), abs=1e-9)
        assert section_limits.excess(limits, found).max() <= 1e-11
        if not answer.converged:
            push = J.T @ error
            normals = section_limits.binding_normals(limits, found)
            left = twists.multipliers_left(-push, np.zeros((0, size)), normals)
            lefts.append(left / max(1e-2, float(np.linalg.norm(push))))
    assert np.quantile(lefts, 0.7) <= 1e-5
    assert max(lefts) <= 2e-2


def test_out_of_reach_no_start_ends_nearer():
    model = shipped()
    rng = np.random.default_rng(8)
    for _ in range(4):
        away = rng.normal(size=3)
        tip = tuple((0.5 * away / np.linalg.norm(away)).tolist())
        answer = model.solver.solve(tip, None, None, (0.0,) * 6)
        for seed in variables(model, 10, seed=9).tolist():
            other = model.solver.solve(tip, None, None, tuple(seed))
            assert other.residual_m >= 0.999 * answer.residual_m - 1e-6


def free_arm(count: int, kernel: Any = None, **changed: Any) -> Any:
    """Sections of 100 mm that bend up to 100 degrees, without planes."""
    given: dict[str, Any] = {
        "backbone": (0.1,) * count,
        "rigid": (0.01,) * count,
        "offset": (0.003, -0.002),
        "bend_max": (math.radians(100.0),) * count,
        "normals": [],
        "offsets": [],
        "tuning": Tuning(ell_m=ELL_M, still_m=1e-5, still_error_m=1e-8),
    }
    return (kernel or load("tendon")).SectionSolver(**{**given, **changed})


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8])
def test_any_number_of_sections_meets_its_targets(count):
    solver, rng = free_arm(count), np.random.default_rng(count)
    for _ in range(10):
        x = rng.uniform(-0.1, 0.1, 2 * count)
        tip = solver.forward(tuple(x.tolist())).tip
        answer = solver.solve(tip, None, None, (0.0,) * (2 * count))
        assert answer.converged
        assert solver.forward(answer.lengths).tip == pytest.approx(tip, abs=1e-6)
        assert np.hypot(*np.reshape(answer.lengths, (-1, 2)).T).max() <= 0.1 * math.radians(100.0) + 1e-12


def test_one_section_of_given_length_is_met_along_its_surface():
    """Its tips are a surface; beside it the error that is left is across the surface."""
    solver = free_arm(1)
    x = np.array([0.06, -0.03])
    tip, J = np.array(solver.forward(tuple(x.tolist())).tip), np.empty((3, 3, 2))
    solver.differentiate(tuple(x.tolist()), *J)
    normal = np.cross(J[0][:, 0], J[0][:, 1])
    normal /= np.linalg.norm(normal)
    off = solver.solve(tuple((tip + 1e-3 * normal).tolist()), None, None, (0.0, 0.0))
    assert not off.converged
    assert off.residual_m == pytest.approx(1e-3, rel=1e-6)
    assert off.lengths == pytest.approx(x, abs=1e-7)


def test_planes_hold_and_are_numbered_before_the_cones():
    normal = np.array([1.0, 0.0, -0.5, 0.0])
    solver = free_arm(2, normals=normal.tolist(), offsets=[0.02])
    tip = solver.forward((0.15, 0.0, -0.05, 0.0)).tip
    answer = solver.solve(tip, None, None, (0.0,) * 4)
    assert normal @ answer.lengths == pytest.approx(0.02, abs=1e-9)
    assert answer.binding & 1
    bound = set()
    for tip in np.random.default_rng(11).uniform(-0.25, 0.25, (20, 3)).tolist():
        bent = solver.solve(tuple(tip), None, None, (0.0,) * 4)
        at_most = np.hypot(*np.reshape(bent.lengths, (-1, 2)).T) > 0.1 * math.radians(100.0) - 1e-9
        plane = normal @ bent.lengths > 0.02 - 1e-9
        assert bent.binding == plane + 2 * at_most[0] + 4 * at_most[1]
        bound.add(bent.binding)
    assert len(bound) >= 4


def test_more_planes_than_any_integer_has_bits_are_named():
    planes = 600
    normals, offsets = np.zeros((planes, 4)), np.ones(planes)
    normals[planes - 1, 0], offsets[planes - 1] = 1.0, 0.01
    solver = free_arm(2, normals=normals.ravel().tolist(), offsets=offsets.tolist())
    answer = solver.solve(solver.forward((0.15, 0.0, 0.1, 0.0)).tip, None, None, (0.0,) * 4)
    assert answer.binding >> (planes - 1) & 1
    assert answer.lengths[0] == pytest.approx(0.01, abs=1e-9)


@pytest.mark.skipif(not has_avx2(), reason="this processor has no AVX2")
def test_every_build_answers_alike():
    """The build for three sections, which is for AVX2, against the one for any number: the same bits."""
    rng = np.random.default_rng(10)
    plain, wide = (importlib.import_module(f"contid.kernels.{name}") for name in ("_tendon", "_tendon_avx2"))
    assert load("tendon") is wide
    general, exact = free_arm(3, plain), free_arm(3, wide)
    for _ in range(30):
        tip = general.forward(tuple(rng.uniform(-0.1, 0.1, 6).tolist())).tip
        assert general.solve(tip, None, None, (0.0,) * 6) == exact.solve(tip, None, None, (0.0,) * 6)


def test_wrong_arguments_are_refused():
    solver: Any = shipped().solver
    zero = (0.0,) * 6
    with pytest.raises(ValueError, match="two numbers per section"):
        solver.forward(zero[:5])
    for arguments, message in (
        (((0.0, 0.0), None, None, zero), "tip: three"),
        (((0.0, 0.0, 0.2), (1.0,), None, zero), "direction: three"),
        (((0.0, 0.0, 0.2), None, (1.0,), zero), "mid: three"),
        (((0.0, 0.0, 0.2), None, None, zero[:4]), "seed: two"),
        (((0.0, 0.0, 0.2), None, None, zero, (1.0,) * 8), "rotation: nine"),
        (((0.0, 0.0, 0.2), (0.0, 0.0, 1.0), (0.0, 0.0, 0.1), zero, (1.0,) * 9), "instead of a direction"),
    ):
        with pytest.raises(ValueError, match=message):
            solver.solve(*arguments)
    with pytest.raises(ValueError, match="tip: an array"):
        solver.differentiate(zero, np.empty((3, 5)), np.empty((3, 6)), np.empty((3, 6)))
    with pytest.raises(ValueError, match="seventeen"):
        solver.avoid([(0.0,) * 16], 0.04, 0.005, 0.0, 0.02, 0.05)


def test_wrong_geometry_is_refused():
    wrong: dict[str, Any] = {"rigid": (0.0,), "offset": (0.0,), "bend_max": (1.0,), "normals": [1.0, 0.0]}
    for name, given in wrong.items():
        with pytest.raises(ValueError, match=f"{name}: "):
            free_arm(2, **{name: given})
    with pytest.raises(ValueError, match="normals: "):
        free_arm(2, offsets=[1.0])
    with pytest.raises(ValueError, match="too many limits"):
        free_arm(2, normals=[0.0] * (4 * 1025), offsets=[1.0] * 1025)
    assert free_arm(2, normals=[0.0] * (4 * 1024), offsets=[1.0] * 1024)
    for count in (0, 9):
        with pytest.raises(ValueError, match="one to eight"):
            free_arm(count)
