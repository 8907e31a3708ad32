"""What passes between the control process and the process of a model arrives to the bit."""

from __future__ import annotations

import math
import pickle
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.control.process.isolation.body import with_isolated_models
from contid.control.process.isolation.model_port import ModelLostError
from contid.control.process.isolation.model_wire import (
    ModelQuestion,
    ModelRaisedError,
    pack_answer,
    pack_error,
    unpack_answer,
)  # fmt: skip
from contid.kinematics.isolated_robot import IsolatedRobot
from contid.robot_file.load import parse_robot_file
from contid.robot_file.robot import RobotDescription
from contid.targets import Pose, Solution, Target
from tests.support.broken.bad_model import ROBOT, installed_in
from tests.support.fingers import fingers

NUMBERS = st.floats(width=64)
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS)
AXES = st.lists(NUMBERS, max_size=4).map(tuple)
TARGETS = st.builds(
    Target, tip_m=st.none() | VECTORS, direction=st.none() | VECTORS, mid_m=st.none() | VECTORS,
    actuation=st.none() | AXES, load_n=VECTORS,
    extra=st.dictionaries(st.text(max_size=5), NUMBERS, max_size=2),
    rotation=st.none() | st.lists(NUMBERS, min_size=9, max_size=9).map(tuple), arcs=st.none() | AXES,
)  # fmt: skip
SOLUTIONS = st.builds(
    Solution, actuation=AXES, residual_m=NUMBERS, converged=st.booleans(),
    limited_by=st.lists(st.text(max_size=5), max_size=3).map(tuple), iterations=st.integers(0, 1000),
    note=st.text(max_size=20),
)  # fmt: skip
POSES = st.builds(
    Pose, tip_m=VECTORS, rotation=st.lists(NUMBERS, min_size=9, max_size=9).map(tuple), direction=VECTORS,
    mid_m=VECTORS, stable=st.booleans(),
)  # fmt: skip


@given(TARGETS, AXES, st.booleans())
def test_a_question_arrives_as_it_was_asked(target: Target, seed: tuple[float, ...], brief: bool) -> None:
    found = ModelQuestion.unpack(ModelQuestion(brief, "inverse", (target, seed)).pack())
    assert repr(found) == repr(ModelQuestion(brief, "inverse", [target, seed]))
    other = ModelQuestion.unpack(ModelQuestion(brief, "shape", (seed, 7, (0.0, 0.0, 1.0))).pack())
    assert repr(other) == repr(ModelQuestion(brief, "shape", [seed, 7, (0.0, 0.0, 1.0)]))


@given(SOLUTIONS, POSES, AXES)
def test_answers_arrive_as_they_were_given(solution: Solution, pose: Pose, axes: tuple[float, ...]) -> None:
    for method, answer in (("inverse", solution), ("forward", pose), ("of_arcs", axes)):
        assert repr(unpack_answer(pack_answer(method, answer))) == repr(answer)


@pytest.mark.parametrize("shape", [(3, 2), (0, 3), (1025, 3)])
def test_an_array_arrives_with_its_bits(shape: tuple[int, ...]) -> None:
    array = np.random.default_rng(1).standard_normal(shape)
    found = unpack_answer(pack_answer("shape", array))
    assert found.shape == shape
    assert found.tobytes() == array.tobytes()
    assert not shape[0] or found.flags.writeable


def test_numbers_of_numpy_arrive_as_numbers_of_python() -> None:
    given = Solution((np.float64(0.1), np.float32(0.1)), np.float64(math.nan), np.bool_(True))  # type: ignore[arg-type]
    found = unpack_answer(pack_answer("inverse", given))
    assert [type(value) for value in found.actuation] == [float, float]
    assert struct.pack("2d", *found.actuation) == struct.pack("2d", 0.1, float(np.float32(0.1)))
    assert found.converged is True


class Strange:
    """No class of contid."""

    def __repr__(self) -> str:
        return "a guess"


@pytest.mark.parametrize(
    ("method", "answer", "words"),
    [
        ("inverse", None, "the model answered None, not a solution"),
        ("inverse", Strange(), "the model answered a guess, not a solution"),
        ("inverse", Solution((Strange(),), 0.0, True), "the model answered a guess"),  # type: ignore[arg-type]
        ("forward", (1.0, 2.0, 3.0), "not a pose"),
        ("shape", "long", "could not convert"),
        ("shape", np.zeros((9000, 3)), "bytes"),
        ("of_arcs", None, "NoneType"),
    ],
)
def test_what_is_no_answer_is_an_error(method: str, answer: Any, words: str) -> None:
    with pytest.raises(ModelRaisedError, match=words):
        unpack_answer(pack_answer(method, answer))


def test_an_error_keeps_its_name_and_not_its_class() -> None:
    with pytest.raises(ModelRaisedError) as raised:
        unpack_answer(pack_error(ZeroDivisionError("float division by zero")))
    assert f"{type(raised.value).__name__}: {raised.value}" == "ZeroDivisionError: float division by zero"
    assert not isinstance(raised.value, ZeroDivisionError)
    assert isinstance(raised.value, ArithmeticError)


def test_a_value_error_of_a_model_is_caught_as_one() -> None:
    """As the check of a row does: the row is refused in its place."""
    with pytest.raises(ValueError, match="no idea") as raised:
        unpack_answer(pack_error(ValueError("no idea")))
    assert isinstance(raised.value, ModelRaisedError)
    assert issubclass(ModelLostError, ValueError)


def test_an_error_without_a_message_is_one_all_the_same() -> None:
    class MuteError(Exception):
        def __str__(self) -> str:
            raise RuntimeError("mute")

    with pytest.raises(ModelRaisedError, match="its message: RuntimeError"):
        unpack_answer(pack_error(MuteError()))


def test_an_isolated_description_answers_as_the_robots_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(installed_in(tmp_path / "site"))
    text = fingers(1, buses=2) + ROBOT.format(name="f1", how="sound", trigger="none", bus="bus1")
    plain = parse_robot_file(text, "fingers.yaml")
    packed = with_isolated_models(plain)
    assert packed.sha256 == plain.sha256
    isolated = packed.file.robots
    assert isolated["f0"] is plain.file.robots["f0"]
    found, own = pickle.loads(pickle.dumps(isolated["f1"])), plain.file.robots["f1"]
    assert isinstance(found, IsolatedRobot)
    for name in (*vars(RobotDescription), *RobotDescription.model_fields, "quantity", "dimension"):
        if name in RobotDescription.model_fields or isinstance(
            getattr(RobotDescription, name, None), property
        ):
            assert getattr(found, name) == getattr(own, name), name
    assert found.described() == own
