"""Results of the library have types: a checker sees arrays, and the fields are those that are declared."""

from __future__ import annotations

import pickle
from importlib.resources import files
from typing import assert_type, get_type_hints

import numpy as np
from numpy.typing import NDArray

from contid import Robot, Sim
from contid.api.results import AnswerRecords, PoseRecords


def test_the_fields_are_those_that_are_declared() -> None:
    robot = Robot("finger")
    answer, pose = robot.ik([[30.0, 85.0], [20.0, 90.0]]), robot.fk([60.0, 60.0])
    for found, kind in ((answer, AnswerRecords), (pose, PoseRecords)):
        assert type(found) is kind
        assert found.dtype.names == tuple(get_type_hints(kind))[: len(found.dtype.names or ())]
    assert np.array_equal(answer[1].actuation, answer.actuation[1])
    assert np.array_equal(answer["residual"], answer.residual)
    assert np.array_equal(pickle.loads(pickle.dumps(answer)).actuation, answer.actuation)


def test_a_checker_sees_arrays() -> None:
    """`assert_type` is judged by mypy, which checks this file (tests/test_quality.py)."""
    robot = Robot("finger")
    answer, pose = robot.ik([[30.0, 85.0]]), robot.fk([60.0, 60.0])
    assert_type(answer.actuation, NDArray[np.float64])
    assert_type(answer.converged, NDArray[np.bool_])
    assert_type(pose.tip, NDArray[np.float64])
    with Sim("finger") as sim:
        assert_type(sim.reset(1)["finger"].tip, NDArray[np.float64])
    # Checkers of users look at types of a package with this file only.
    assert files("contid").joinpath("py.typed").is_file()
