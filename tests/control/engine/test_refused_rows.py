"""Rows that a robot refuses amid its motion: its stop, and its way to the next good row, keep every limit.

Near limits that axes share, such as a bend, the jerk was exceeded up to 10 times, and 18 by a garbage policy.
"""

from __future__ import annotations

import numpy as np
import pytest

from contid import Robot, Sim
from contid.kinematics.array import Array

TICKS = 1800


def rates(name: str, seed: int) -> tuple[Array, set[str], int]:
    """Greatest velocity, acceleration and jerk as shares of the limits, modes, and rows that were refused."""
    random, robot = np.random.default_rng(seed), Robot(name)
    limits = robot.limits
    low, high = np.array(limits.min), np.array(limits.max)
    commands, modes, refused = [], set(), 0
    with Sim(name) as sim:
        (only,) = sim.names
        asked = before = np.clip(sim.state.robots[only].command, low, high)
        for tick in range(TICKS):
            if tick % 20 == 0:
                pace = random.choice([0.0, 0.3, 1.0, 1.0]) * random.uniform(-1.0, 1.0, len(low))
            asked = np.clip(asked + pace * np.array(limits.velocity) / sim.rate_hz, low, high)
            state = sim.step(dict(zip(limits.names, asked.tolist(), strict=True))).robots[only]
            refused += bool(state.refused)
            before = asked = before if state.refused else asked
            commands.append(state.command)
            modes.add(state.mode)
        h = 1.0 / sim.rate_hz
    found = [
        (np.abs(np.diff(commands, order, axis=0)) / h**order / np.array(limit)).max()
        for order, limit in enumerate((limits.velocity, limits.acceleration, limits.jerk), start=1)
    ]
    return np.array(found), modes, refused


@pytest.mark.parametrize(
    ("name", "seed"),
    [("catheter", 1), pytest.param("trirack", 1, marks=pytest.mark.campaign), ("trirack2", 2)],
)
def test_limits_hold_amid_refused_rows(name: str, seed: int) -> None:
    found, modes, refused = rates(name, seed)
    assert refused > 100
    assert {"RUN", "HOLD", "APPROACH"} <= modes
    assert found.max() <= 1.0 + 1e-5, found
