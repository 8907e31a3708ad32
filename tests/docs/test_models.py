"""The model that docs/models.md adds, run from the page as it stands."""

from __future__ import annotations

import json
import math
import random
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from contid.kinematics import model as models
from contid.robot_file.positions import read_document
from contid.targets import Target

PAGE = (Path(__file__).parent.parent.parent / "docs" / "models.md").read_text()


@pytest.fixture(scope="module")
def vine() -> Iterator[Any]:
    """The model of the page's robot, built by the table of models."""
    description, arithmetic = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    patch = pytest.MonkeyPatch()
    for name, source in (("contid.robot_file.vine", description), ("contid.kinematics.vine", arithmetic)):
        module = ModuleType(name)
        patch.setitem(sys.modules, name, module)
        exec(compile(source, name, "exec"), module.__dict__)
    patch.setitem(models.MODELS, "vine", "contid.kinematics.vine:VineModel")
    text = re.findall(r"^```yaml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)[0]
    document: Any = read_document(text, "page").data
    data = document["robots"]["vine"]
    robot = sys.modules["contid.robot_file.vine"].Vine.model_validate_json(json.dumps(data), strict=True)
    yield models.build_model(robot)
    patch.undo()


def reached(vine: Any) -> list[tuple[float, ...]]:
    """Actuations from all over the range, the straight line included."""
    chance = random.Random(7)
    some = [
        tuple(chance.uniform(low, high) for low, high in zip(vine.lower, vine.upper, strict=True))
        for _ in range(200)
    ]
    return [*some, (0.1, 0.0), (0.1, 1e-12), (0.1, -1e-7)]


def test_the_inverse_undoes_the_forward(vine: Any) -> None:
    for actuation in reached(vine):
        solution = vine.inverse(Target(tip_m=vine.forward(actuation).tip_m), vine.lower)
        assert solution.converged
        assert solution.actuation == pytest.approx(actuation, abs=1e-12)


def test_the_jacobian_is_the_derivative(vine: Any) -> None:
    step = 1e-6
    for feed, pull in reached(vine):
        found = vine.jacobian((feed, pull))
        columns = [
            np.subtract(vine.forward(above).tip_m, vine.forward(below).tip_m) / (2 * step)
            for above, below in (
                ((feed + step, pull), (feed - step, pull)),
                ((feed, pull + step), (feed, pull - step)),
            )
        ]
        assert found == pytest.approx(np.array(columns).T, abs=1e-6)


def test_out_of_reach_is_an_answer_inside_the_limits(vine: Any) -> None:
    solution = vine.inverse(Target(tip_m=(0.0, 0.5, 0.0)), vine.lower)
    assert not solution.converged
    assert solution.limited_by == ("feed.max",)
    assert solution.residual_m == pytest.approx(0.2)
    assert vine.inverse(Target(actuation=(9.0, 0.0)), vine.lower).actuation == (vine.upper[0], 0.0)


def test_the_shape_ends_at_the_tip_and_has_the_length_that_was_fed(vine: Any) -> None:
    for feed, pull in reached(vine):
        line = vine.shape((feed, pull), 400)
        assert line[-1] == pytest.approx(vine.forward((feed, pull)).tip_m)
        assert sum(map(math.dist, line[:-1], line[1:])) == pytest.approx(feed, rel=1e-4)
