"""Loads that are none: the estimate of the tick beside an arm without a load that moves and swings.

The plant is the moving twin of `tests.sense.swinging`, the regulators and the tracker are those of
`tests.sense.observed`.

    python -m tests.sense.swinging_loads [MINUTES]
"""

from __future__ import annotations

import sys

import numpy as np

from tests.sense.figures import on_spirals
from tests.sense.observed import GRAM_N, Run, calibrated, plant
from tests.sense.swinging import SwingingArm

MOVES = 20


def run_of(swings: bool) -> Run:
    """The estimate, with its file's key ``sense.load.swings``, beside an arm at rest."""
    rng = np.random.default_rng(100)
    robot = calibrated(plant(), rng)
    assert robot.sense is not None
    load = robot.sense.load.model_copy(update={"swings": swings})
    run = Run(
        robot.model_copy(update={"sense": robot.sense.model_copy(update={"load": load})}), SwingingArm(), rng
    )
    run.move(np.full(6, 0.6))
    run.rest(2.0)
    return run


def spirals(run: Run, minutes: float) -> str:
    """Jumps of the estimate while the pressures go in circles of changing radius."""
    changes, found_g = on_spirals(run, minutes)
    median, high, most = np.quantile(found_g, [0.5, 0.99, 1.0])
    return (
        f"{len(changes)} jumps of the estimate, {sum(each > 1.0 for each in changes)} by more than 1 g; "
        f"found: median {median:.2f} g, p99 {high:.2f}, greatest {most:.2f}"
    )


def moves(run: Run) -> str:
    """The estimate 2 s after random moves."""
    found_g = []
    for _ in range(MOVES):
        run.move(run.rng.uniform(0.05, 1.2, 6), run.rng.uniform(0.3, 1.2))
        run.rest(2.0)
        found_g.append(run.found()[0] / GRAM_N)
    sideways, across, along = np.sqrt((np.array(found_g) ** 2).mean(axis=0))
    return f"2 s after {MOVES} random moves: rms {sideways:.2f}, {across:.2f}, {along:.2f} g"


if __name__ == "__main__":
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    for swings in (False, True):
        run = run_of(swings)
        print(f"swings: {str(swings).lower()}: {minutes:g} simulated minutes, {spirals(run, minutes)}")
        print(f"  {moves(run)}")
