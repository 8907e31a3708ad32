"""Critical loads of the pneumatic arms and the verdicts of `forward`, beside `rod_walk`.

``python -m tests.oracles.critical --cases 10000``. Half the cases have pressures over their whole range and
loads in any direction; the others nearly equal pressures and loads nearly along the arm, where it buckles.
All of a chunk have the same load. A critical load must be that at which the walk ends, and an arm must be
stable under pressures and load raised together where the walk gets there.
"""

from __future__ import annotations

import argparse
import math
import sys
from typing import TypeAlias

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.branch import SAME_FACTOR, load_scale
from contid.kinematics.cosserat.engine import NumpyEngine
from contid.kinematics.cosserat.model import CosseratModel
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.shipped import load_named
from contid.units import BAR
from tests.oracles.rod_walk import walk

Verdicts: TypeAlias = "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]"

#: Tip force up to which critical loads are looked for, and cases that share it.
MOST_N, CHUNK = 0.5, 50
#: How far the others are from equal pressures, as a part of their range, and from a load along the arm.
NEARLY = 0.03
#: Difference of factors that the two discretisations may have: each is given to `SAME_FACTOR`.
ALLOWED = 2.0 * SAME_FACTOR


def compare(model: CosseratModel, bars: Array, load: Array) -> tuple[Array, Array, Verdicts, Verdicts]:
    """Factors of the load at which arms (n, 3k) [bar] buckle, by contid and by the walk; stable by both."""
    force = (float(load[0]), float(load[1]), float(load[2]))
    loads = NumpyEngine(model.setup).setup.loads(force)
    rod, pressures = model.setup.rod, [tuple((p * BAR).tolist()) for p in bars]
    scale = load_scale(rod, loads)
    critical = [model.critical_load_n(p, force) for p in pressures]
    ours = np.array([1.0 if n is None else n / math.hypot(*force) for n in critical])
    stable = np.array([model.forward(p, force).stable for p in pressures])
    pressed, raised = walk(rod, loads, scale, bars, pressed=True), walk(rod, loads, scale, bars)
    return ours, pressed.done, stable, raised.there


def count(name: str, cases: int, seed: int) -> bool:
    """Print one line for a robot; False where the two differ."""
    (robot,) = load_named(name).file.robots.values()
    assert isinstance(robot, Cosserat)
    model, rng = CosseratModel(robot), np.random.default_rng([seed, len(robot.geometry.sections)])
    low, high = model.setup.limits.lower, model.setup.limits.upper
    found = []
    for begin in range(0, cases, CHUNK):
        share = rng.uniform(size=(min(CHUNK, cases - begin), len(low)))
        load = rng.normal(size=3)
        if begin // CHUNK % 2:
            load = np.array([0.0, 0.0, -1.0]) + NEARLY * load
            share = share[:, :1] + NEARLY * rng.uniform(-1.0, 1.0, share.shape)
        load *= rng.uniform(0.1, 1.0) * MOST_N / np.linalg.norm(load)
        bars = low + np.clip(share, 0.0, 1.0) * (high - low)
        found.append(compare(model, bars, load))
        for bar, *row in zip(bars, *found[-1], strict=True):
            if abs(row[0] - row[1]) > ALLOWED * row[1] or row[2] != row[3]:
                print(f"{name}: {bar.tolist()} bar, {load.tolist()} N: {row}", flush=True)
    ours, theirs, stable, there = (np.concatenate(each) for each in zip(*found, strict=True))
    off = np.abs(ours - theirs) / theirs
    print(
        f"critical {name} loads to {MOST_N:g} N: {np.sum(theirs < 1.0)} of {cases} buckle, "
        f"{np.sum(off > ALLOWED)} critical loads differ by more than {ALLOWED:.0%} (worst {off.max():.2g}); "
        f"{np.sum(there)} stable, {np.sum(stable != there)} verdicts differ",
        flush=True,
    )
    return bool(np.all(off <= ALLOWED) and np.array_equal(stable, there))


def main() -> int:
    """Count for both arms; exit 1 where a critical load or a verdict differs."""
    parser = argparse.ArgumentParser(prog="python -m tests.oracles.critical")
    parser.add_argument("--cases", type=int, default=1000, help="for each arm")
    parser.add_argument("--seed", type=int, default=16)
    given = parser.parse_args()
    held = [count(name, given.cases, given.seed) for name in ("stiffflop1", "stiffflop2")]
    return 0 if all(held) else 1


if __name__ == "__main__":
    sys.exit(main())
