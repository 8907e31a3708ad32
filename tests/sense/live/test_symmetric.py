"""Symmetric matrices of three rows beside numpy."""

import numpy as np
import pytest

from contid.sense.live.symmetric import cofactors, squared_distance


def test_it_is_what_numpy_finds():
    rng = np.random.default_rng(1)
    for _ in range(50):
        root = rng.normal(size=(3, 3)) * np.exp(rng.uniform(-3.0, 3.0, 3))
        matrix, point = root @ root.T, rng.normal(size=3)
        (a, b, c), (_, d, e), (_, _, f) = matrix.tolist()
        inverse, determinant = cofactors((a, b, c, d, e, f))
        assert determinant == pytest.approx(np.linalg.det(matrix), rel=1e-6)
        a2, b2, c2, d2, e2, f2 = inverse
        rows = np.array([[a2, b2, c2], [b2, d2, e2], [c2, e2, f2]]) / determinant
        assert rows @ matrix == pytest.approx(np.eye(3), abs=1e-5)
        expected = point @ np.linalg.solve(matrix, point)
        assert squared_distance(tuple(point.tolist()), (a, b, c, d, e, f)) == pytest.approx(
            expected, rel=1e-5
        )
