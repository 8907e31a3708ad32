"""`Sim.reset`: as a new simulation to the bit, with other noise by a seed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contid import Sim
from contid.errors import ContidError
from contid.robot_file.load import LoadedFile

GOALS = {"finger": {"x_mm": 30.0, "y_mm": 85.0}, "hand": {"left.x_mm": 10.0, "left.y_mm": 80.0}}


def played(sim: Sim, goal: dict[str, float], ticks: int = 120) -> list[list[float]]:
    """All values of every tick's record, NaN as itself."""
    rows = []
    for tick in range(ticks):
        sim.step(goal if tick % 40 == 0 else None)
        rows.append([*sim._values])
    return rows


def same(first: Any, second: Any) -> bool:
    return bool(np.array_equal(np.array(first), np.array(second), equal_nan=True))


@pytest.mark.parametrize("name", GOALS)
def test_a_reset_is_a_new_simulation_to_the_bit(name: str) -> None:
    with Sim(name) as sim, Sim(name) as other:
        fresh = played(other, GOALS[name])
        first = played(sim, GOALS[name])
        sim.step(ticks=33)
        sim.hold()
        sim.step({next(iter(GOALS[name])): 500.0, [*GOALS[name]][1]: 500.0}, ticks=3)
        again = sim.reset()
        assert again.tick == 2
        assert [robot.refused for robot in again.robots.values()] == ["" for _ in sim.names]
        assert same(played(sim, GOALS[name]), first)
        assert same(first, fresh)


def test_a_seed_is_another_noise_and_repeats() -> None:
    with Sim("finger") as sim:
        runs = []
        for seed in (None, 7, 8, 7):
            sim.reset(seed)
            runs.append(played(sim, GOALS["finger"], 30))
        assert same(runs[1], runs[3])
        assert not same(runs[1], runs[2])
        assert not same(runs[0], runs[1])


def test_what_records_is_not_reset(tmp_path: Path) -> None:
    sim = Sim("finger", record=tmp_path / "one.mcap")
    with sim, pytest.raises(ContidError, match="a session is one run; make a new one"):
        sim.reset()
    with pytest.raises(ContidError, match="closed"):
        sim.reset()


def test_a_variant_that_is_refused_leaves_the_simulation_as_it_was() -> None:
    def refused(_: LoadedFile) -> LoadedFile:
        raise ContidError("no such variant")

    with Sim("finger") as sim, Sim("finger") as other:
        with pytest.raises(ContidError, match="no such variant"):
            sim.reset(variant=refused)
        assert same(played(sim, GOALS["finger"], 30), played(other, GOALS["finger"], 30))
