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
from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.model import CosseratModel
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_named
from contid.targets import Vec3
from contid.units import BAR
from tests.oracles.rod_walk import LEAST_STEP, load_scale, walk

#: Tip force up to which critical loads are looked for, and cases that share it.
MOST_N, CHUNK = 0.5, 25
#: How far the others are from equal pressures, as a part of their range, and from a load along the arm.
NEARLY = 0.03
#: Difference of factors that the two discretisations may have: each is given to half a percent.
ALLOWED = 0.01
#: A tip that goes 4 % of the reach within this part of a path, contid's least step, may count as a snap.
SWINGING = 5e-5


@dataclass(frozen=True)
class Compared:
    """Factors of the load at which an arm buckles, and whether it is stable under it."""

    factor: float
    stable: bool

    def agrees(self, other: Compared) -> bool:
        """True for the same verdict and, nearly, the same factor."""
        return self.stable == other.stable and abs(self.factor - other.factor) <= ALLOWED * other.factor


def solved(model: CosseratModel, bar: Array, force: Vec3) -> Compared:
    """By contid."""
    pressures = tuple((bar * BAR).tolist())
    critical = model.critical_load_n(pressures, force)
    factor = 1.0 if critical is None else critical / math.hypot(*force)
    return Compared(factor, model.forward(pressures, force).stable)


def walked(model: CosseratModel, bars: Array, force: Vec3, least: float = LEAST_STEP) -> list[Compared]:
    """By walks; a tip that moves too far within the least part of a path has snapped."""
    rod, loads = model.setup.rod, model.setup.loads(force)
    scale = load_scale(rod, loads)
    pressed = walk(rod, loads, scale, bars, pressed=True, least=least).done
    raised = walk(rod, loads, scale, bars, least=least).there
    return [Compared(float(a), bool(b)) for a, b in zip(pressed, raised, strict=True)]


def count(name: str, cases: int, seed: int) -> bool:
    """Print one line for a robot; False where the two differ."""
    (robot,) = load_named(name).file.robots.values()
    assert isinstance(robot, Cosserat)
    model, rng = CosseratModel(robot), np.random.default_rng([seed, len(robot.geometry.sections)])
    low, high = model.setup.limits.lower, model.setup.limits.upper
    wrong, swinging = 0, 0
    found: list[Compared] = []
    for begin in range(0, cases, CHUNK):
        share = rng.uniform(size=(min(CHUNK, cases - begin), len(low)))
        load = rng.normal(size=3)
        if begin // CHUNK % 2:
            load = np.array([0.0, 0.0, -1.0]) + NEARLY * load
            share = share[:, :1] + NEARLY * rng.uniform(-1.0, 1.0, share.shape)
        load *= rng.uniform(0.1, 1.0) * MOST_N / np.linalg.norm(load)
        force = (float(load[0]), float(load[1]), float(load[2]))
        bars = low + np.clip(share, 0.0, 1.0) * (high - low)
        for bar, theirs in zip(bars, walked(model, bars, force), strict=True):
            found.append(ours := solved(model, bar, force))
            if ours.agrees(theirs):
                continue
            if ours.agrees(walked(model, bar[None], force, SWINGING)[0]):
                swinging += 1
            else:
                wrong += 1
                print(f"{name}: {bar.tolist()} bar, {force} N: {ours}, {theirs}", flush=True)
    print(
        f"critical {name} loads to {MOST_N:g} N, {cases} cases: {sum(one.factor < 1.0 for one in found)} "
        f"buckle, {sum(not one.stable for one in found)} are unstable, {wrong} differ from the walk, "
        f"{swinging} swing as fast as they would snap",
        flush=True,
    )
    return wrong == 0


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
