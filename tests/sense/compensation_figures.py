"""Compensation of an unknown payload of 10 g at resting tips, by the estimate, by tip feedback and by both.

Every arm has its own regulators, calibration and tips; the plant is that of `tests.sense.figures`.

    python -m tests.sense.compensation_figures [ARMS] [TIPS] [FIRST_SEED]
"""

from __future__ import annotations

import sys

import numpy as np

from tests.sense.compensated import arm_of, reached_tip, resting

WAYS = {
    "without": (False, False),
    "load: estimated": (True, False),
    "with tip feedback too": (True, True),
    "tip feedback alone": (False, True),
}


def main(arms: int, tips: int, first: int) -> None:
    """Print distances of the tips from their targets."""
    runs: dict[str, list[tuple[float, float, float]]] = {way: [] for way in WAYS}
    for seed in range(first, first + arms):
        robot, rng = arm_of(seed)
        for _ in range(tips):
            tip = reached_tip(robot, rng)
            for way, (estimated, feedback) in WAYS.items():
                found = resting(robot, tip, estimated=estimated, feedback=feedback)
                empty, loaded = (1e3 * np.linalg.norm(each - tip) for each in (found.empty_m, found.loaded_m))
                runs[way].append((float(empty), float(loaded), 1e3 * found.step_bar))
    print(
        f"{arms * tips} tips on {arms} arms, seeds {first} to {first + arms - 1}; distances from the target"
    )
    without = np.array(runs["without"])[:, 1]
    for way, rows in runs.items():
        off, held, step = np.array(rows).T
        print(f"{way}: without load {shown(off)}; with 10 g {shown(held)}")
        if way != "without":
            less = 100.0 * (1.0 - held / without)
            low, mid = np.quantile(less, [0.1, 0.5])
            print(
                f"  less by median {mid:.1f} %, lowest decile {low:.1f} %, least {less.min():.1f} %, "
                f"of the means {100.0 * (1.0 - held.mean() / without.mean()):.1f} %; "
                f"tracker lost: steps up to {np.median(step):.1f} (median), {step.max():.1f} mbar"
            )


def shown(values: np.ndarray) -> str:
    """Median, ninth decile and greatest."""
    mid, high = np.quantile(values, [0.5, 0.9])
    return f"p50 {mid:.2f}, p90 {high:.2f}, max {values.max():.2f} mm"


if __name__ == "__main__":
    given = [int(each) for each in sys.argv[1:]]
    main(*(*given, *(8, 3, 0)[len(given) :]))
