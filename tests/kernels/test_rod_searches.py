"""Searches beside the best of scipy, and beside themselves: ``tests.oracles.searches`` drew them."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from contid.kinematics.cosserat.engine import InverseAnswer, RodSolver
from tests.kernels.rod_tasks import Task
from tests.oracles.searches import FILE, arms, solve, solvers_of

ROWS: list[dict[str, Any]] = json.loads(FILE.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def solvers() -> dict[tuple[int, bool], RodSolver]:
    return solvers_of(arms())


@pytest.mark.parametrize(
    "row",
    [pytest.param(row, marks=pytest.mark.campaign if k % 3 else (), id=f"{k}") for k, row in enumerate(ROWS)],
)
def test_a_search_ends_where_it_did_and_on_the_branch(
    row: dict[str, Any], solvers: dict[tuple[int, bool], RodSolver]
) -> None:
    """Work and answer as they were, a pose of `forward`, and as near as scipy's best where that was so."""
    found, before = solve(solvers, row), InverseAnswer(**row["answer"])
    engine = solvers[row["arm"], row["thorough"]]
    limits = engine.setup.limits
    bar = np.array(found.pressures_bar)
    assert np.all((bar >= limits.lower) & (bar <= limits.upper))
    assert found.balance_nmm < 1e-6
    task = Task(row["tip"], row.get("mid"), row.get("direction"), row["force"])
    assert engine.forward(found.pressures_bar, row["force"]).stable
    left = float(np.linalg.norm(task.error(engine, bar)))
    assert left == pytest.approx(found.residual_mm, abs=0.05)
    assert found.residual_mm <= max(before.residual_mm, row["best_mm"]) + 1e-3
    assert bar == pytest.approx(before.pressures_bar, abs=1e-6)
    assert found.residual_mm == pytest.approx(before.residual_mm, abs=1e-5)
    assert found.iterations == before.iterations
    assert found.snap == pytest.approx(before.snap, abs=1e-6)
    assert (found.met, found.optimal, found.stable) == (before.met, before.optimal, True)
    assert (found.blocked, found.elements) == (before.blocked, before.elements)
