"""The native kernel of tendon robots against its specification in NumPy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contid.kernels import PURE_PYTHON, load
from contid.kinematics.arc.sections import differentiate, forward
from contid.kinematics.tendon.bend_solver import build_bend_solver
from contid.kinematics.tendon.model import TendonModel
from tests.kinematics.tendon_robots import placed, random_bends, shipped, vec

pytestmark = pytest.mark.skipif(
    load("tendon") is None, reason="the kernel is not built, or CONTID_PURE_PYTHON is set"
)


def test_frames_and_jacobians():
    model = shipped()
    lengths = np.repeat(model.feasible.sections.backbone_m, 2)
    for bends in (*random_bends(model, 50, seed=1), np.zeros(6), np.full(6, 1e-9)):
        x = tuple((bends * lengths).tolist())
        tip, rotation, mid = model.solver.forward(x)
        expected = forward(model.feasible.sections, x)
        np.testing.assert_allclose(tip, expected.tip, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(np.reshape(rotation, (3, 3)), expected.rotation, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(mid, expected.mid, rtol=1e-12, atol=1e-14)
        arrays = np.full((3, 3, 6), math.nan)
        model.solver.differentiate(x, *arrays)
        at = differentiate(model.feasible.sections, x)
        for got, exact in zip(arrays, (at.tip, at.spin, at.mid), strict=True):
            np.testing.assert_allclose(got, exact, rtol=1e-12, atol=1e-12 * np.abs(exact).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tendon3", "ftdcr_v4"])
@pytest.mark.parametrize("mode", ["tip", "direction", "mid", "rotation"])
def test_the_solver_takes_the_same_steps(name, mode, monkeypatch):
    model = shipped(name)
    monkeypatch.setenv(PURE_PYTHON, "1")
    twin = build_bend_solver(model.feasible)
    lengths = np.repeat(model.feasible.sections.backbone_m, 2)
    poses = 5 if mode == "rotation" else 15  # the twin takes up to seconds for a frame
    seeds = random_bends(model, poses, seed=5) * lengths
    for bends, seed in zip(random_bends(model, poses, seed=4), seeds, strict=True):
        tip, tangent, mid = placed(model, bends)
        tip[2] -= model.geometry.base_offset_m
        mid[2] -= model.geometry.base_offset_m
        goal = (
            vec(tip),
            vec(tangent) if mode == "direction" else None,
            vec(mid) if mode == "mid" else None,
            tuple(seed.tolist()),
            model.solver.forward(tuple((bends * lengths).tolist()))[1] if mode == "rotation" else None,
        )
        ours, spec = model.solver.solve(*goal), twin.solve(*goal)
        np.testing.assert_allclose(ours[0], spec[0], atol=1e-7)
        assert ours[2] == spec[2]
        assert ours[5] == spec[5]


@pytest.mark.slow
def test_the_same_answers_out_of_reach(monkeypatch):
    model: TendonModel = shipped()
    monkeypatch.setenv(PURE_PYTHON, "1")
    twin = build_bend_solver(model.feasible)
    rng = np.random.default_rng(6)
    for _ in range(3):
        away = rng.normal(size=3)
        goal = vec(0.7 * away / np.linalg.norm(away)), None, None, (0.0,) * 6
        ours, spec = model.solver.solve(*goal), twin.solve(*goal)
        assert ours[1] == pytest.approx(spec[1], abs=1e-8)
        assert ours[2] is spec[2] is False


def test_wrong_arguments_are_refused():
    model = shipped()
    with pytest.raises(ValueError, match="two numbers per section"):
        model.solver.forward((0.0,) * 5)
    with pytest.raises(ValueError, match="tip"):
        model.solver.solve((0.0, 0.0), None, None, (0.0,) * 6)  # type: ignore[arg-type]  # that is the test
