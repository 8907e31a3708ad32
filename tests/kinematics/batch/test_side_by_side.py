"""Batches that run at the same time, in several threads of Python with threads of their own, disturb none."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import yaml

from contid.kinematics.batch import Targets, forward_many, inverse_many
from contid.kinematics.model import Model, build_model
from contid.robot_file.document import RobotFile

CONFIGS = Path(__file__).parents[3] / "configs"
#: One for each kernel with batches; three blocks of rows, so that every thread gets one.
ROBOTS = (
    *("finger", "trirack", "stiffflop1", "tendon3"),
    pytest.param("trirack2", marks=pytest.mark.campaign),  # that of trirack
    pytest.param("ftdcr_v4", marks=pytest.mark.campaign),  # that of tendon3
)
ROWS = 70


def model_of(name: str) -> Model:
    raw = yaml.safe_load((CONFIGS / f"{name}.yaml").read_text())
    return build_model(next(iter(RobotFile.model_validate(raw).robots.values())))


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_batches_at_the_same_time_give_the_same_bits(name: str) -> None:
    model = model_of(name)
    low, high = np.array(model.lower), np.array(model.upper)
    share = np.random.default_rng(18).uniform(0.0, 1.0, (ROWS, len(low)))
    actuations = low + share * (high - low)
    poses = forward_many(model, actuations, threads=1)
    targets = Targets.of(poses["tip_m"].copy())
    answers = inverse_many(model, targets, actuations[:1], threads=1)

    def batch(number: int) -> bytes:
        other = model if number % 2 else model_of(name)  # a shared model, and one of its own
        again = forward_many(other, actuations, threads=3).tobytes()
        return again + inverse_many(other, targets, actuations[:1], threads=3).rows.tobytes()

    with ThreadPoolExecutor(3) as threads:
        found = set(threads.map(batch, range(3)))
    assert found == {poses.tobytes() + answers.rows.tobytes()}
