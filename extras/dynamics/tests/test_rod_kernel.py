"""The kernel of rods in motion takes no array that it cannot fill, and no number that is none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from contid.robot_file.load import load_named
from contid_dynamics.arm import MovingArm


@pytest.fixture
def kernel() -> Any:
    (robot,) = load_named("tendon3").driven.values()
    return next(each for each in vars(MovingArm(robot).rod).values() if type(each).__name__ == "Rod")


@pytest.mark.parametrize(
    "wrong",
    [np.zeros((13, 12), dtype=np.float32), np.zeros((13, 12), dtype=int), np.zeros((13, 24))[:, ::2]],
    ids=["float32", "integers", "strided"],
)
def test_poses_are_written_into_what_was_given_or_refused(kernel: Any, wrong: Any) -> None:
    good = np.zeros((13, 12))
    kernel.poses(good)
    assert good[-1, 2] > 0.1
    with pytest.raises(TypeError, match="incompatible"):
        kernel.poses(wrong)
    with pytest.raises(TypeError, match="incompatible"):
        kernel.run(1e-3, 1, [12], wrong[:2, None, :])
    with pytest.raises(TypeError, match="incompatible"):
        kernel.linearise(wrong, wrong)


def test_strains_and_loads_that_are_no_numbers_leave_everything_as_it_was(kernel: Any) -> None:
    before, after = np.zeros((13, 12)), np.zeros((13, 12))
    kernel.poses(before)
    count = 12
    with pytest.raises(ValueError, match="finite"):
        kernel.put(np.full(6 * count, np.nan))
    zeros = np.zeros(6 * count)
    for wrong in (
        (zeros, np.ones(6 * count), np.zeros(99)),
        (np.full(6 * count, np.inf), np.ones(6 * count), np.zeros(9)),
        (zeros, np.ones(6 * count), np.full(9, np.nan)),
    ):
        energy = kernel.potential()
        with pytest.raises(ValueError, match=r"finite|pulls"):
            kernel.load((0.0, 0.0, 0.0), *wrong, 0.0)
        assert kernel.potential() == energy
    kernel.poses(after)
    assert (after == before).all()
