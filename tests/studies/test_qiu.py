"""The baseline of full poses: what it finds is a solution, by rotations of scipy."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from studies.qiu import QiuSolver
from tests.kinematics.tendon_robots import frame_of, placed, random_bends, shipped


def test_it_meets_random_poses() -> None:
    model = shipped()
    solver = QiuSolver(0.1, 0.06)
    offset, base = np.array(model.geometry.tip_offset_m), np.array([0.0, 0.0, model.geometry.base_offset_m])
    met = 0
    for bends in random_bends(model, 12, seed=9):
        tip, _, _ = placed(model, bends)
        frame = frame_of(model, bends)
        found, error = solver.solve(tip - base - frame @ offset, frame)
        if error > 1e-6:
            continue
        met += 1
        reached = found / 0.1
        np.testing.assert_allclose(placed(model, reached)[0], tip, atol=2e-6)
        assert Rotation.from_matrix(frame_of(model, reached) @ frame.T).magnitude() < 1e-4
    assert met >= 11
