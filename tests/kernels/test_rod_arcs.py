"""Rows of a pneumatic arm that carries nothing: their own sweep against the specification in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from contid.kernels import load
from contid.kinematics.batch.kernel import in_bytes
from contid.kinematics.batch.rows import solution_dtype
from contid.kinematics.cosserat.engine import NumpyEngine, RodSetup
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Rod
from contid.targets import ZERO3, Vec3
from tests.kinematics.cosserat_cases import limits, section

pytestmark = pytest.mark.skipif(
    load("cosserat") is None, reason="the kernel is not built, or CONTID_PURE_PYTHON is set"
)
ROWS = 6


@pytest.mark.slow
@pytest.mark.parametrize("elements", [1, 3])
@pytest.mark.parametrize(("sections", "tip_link"), [(1, 0.0), (2, 0.0), (2, 3.0), (3, 3.0)])
def test_answers_of_the_specification(sections: int, tip_link: float, elements: int) -> None:
    """Strong bends, so that an element turns by more than a radian; links, and sections of two kinds."""
    links = [5.0] * (sections - 1) + [tip_link]
    parts = tuple(section(i % 2, link, first_pair_rad=0.3 * i) for i, link in enumerate(links))
    arm = RodSetup(Rod(parts), Loads(), limits(sections), elements, 1e9, 1e-9, 42.0, False)
    kernel = load("cosserat")
    assert kernel is not None
    numpy, engine = NumpyEngine(arm), kernel.Engine(arm)
    rng = np.random.default_rng(sections)
    pressures = rng.uniform(0.0, 1.5, (ROWS, 3 * sections))
    ends = [numpy.forward(row, ZERO3) for row in pressures.tolist()]
    tips, mids = (np.array([end[part] for end in ends]) for part in (0, 2))
    seeds = np.clip(0.9 * pressures + 0.05, 0.0, 1.5)
    found = np.zeros(ROWS, solution_dtype(3 * sections))
    engine.inverse_many(tips, mids if sections == 2 else None, None, None, seeds, in_bytes(found), 1)
    assert found["converged"].all()
    for k in range(ROWS):
        mid = vec3(mids[k]) if sections == 2 else None
        answer = numpy.inverse(vec3(tips[k]), mid, None, ZERO3, seeds[k].tolist())
        assert answer[2]
        assert np.abs(np.array(answer[0]) - found["actuation"][k]).max() < 1e-6
        tip = numpy.forward(found["actuation"][k].tolist(), ZERO3)[0]
        assert np.abs(np.array(tip) - tips[k]).max() < 1e-8


def vec3(row: np.ndarray) -> Vec3:
    x, y, z = row.tolist()
    return x, y, z
