"""Arrays that kernels fill: an array that would be filled as a copy is refused, and nothing is half done."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from contid.kinematics.model import build_model
from contid.robot_file.load import load_named

#: Arrays of the right shape that share no memory with an array of numbers.
COPIES: dict[str, Callable[[Any], Any]] = {
    "float32": lambda shape: np.zeros(shape, dtype=np.float32),
    "integers": lambda shape: np.zeros(shape, dtype=np.int64),
    "strided": lambda shape: np.zeros((*shape[:-1], 2 * shape[-1]))[..., ::2],
    "read-only": lambda shape: np.broadcast_to(np.zeros(shape[-1]), shape),
}


@pytest.mark.parametrize("kind", COPIES)
@pytest.mark.parametrize("name", ["trirack2", "tendon3"])
def test_jacobians_are_written_into_what_was_given_or_refused(name: str, kind: str) -> None:
    (robot,) = load_named(name).driven.values()
    model: Any = build_model(robot)
    at = [0.01, 0.02] * len(model.feasible.sections.backbone_m) if name == "tendon3" else robot.rest[:6]
    solver, count = model.solver, len(at)
    given = [np.zeros((3, count)) for _ in range(3)]
    solver.differentiate(tuple(at), *given)
    assert np.abs(given[0]).max() > 0.0
    for wrong in range(3):
        arrays = [COPIES[kind]((3, count)) if k == wrong else np.zeros((3, count)) for k in range(3)]
        with pytest.raises(TypeError, match="incompatible"):
            solver.differentiate(tuple(at), *arrays)
