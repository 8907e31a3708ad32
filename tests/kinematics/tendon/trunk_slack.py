"""The tendons of `trunk` over random targets: none is slack, none is pulled beyond its limit.

python -m tests.kinematics.tendon.trunk_slack TARGETS [--seed N]

The tensions are those with which the energy of springs and hose is least, written from the robot file with
numpy and without the kinematics of contid, which only give the travels of the motors.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from contid import Robot
from contid.robot_file.load import configs_folder

ROWS = 20_000
#: One of so many targets is anywhere, mostly out of reach.
ANYWHERE = 50

Array = NDArray[np.float64]


@dataclass
class Statics:
    """Twelve tendons, six bends, six motors: ``tension = pretension + stiffness (pull - shortening)``."""

    pulls: Array  # (tendons, motors), of a travel
    shortenings: Array  # (tendons, bend components) [mm/rad]
    stiffness: Array  # (tendons,) [N/mm], with the spring in series
    bending: Array  # (bend components,) [N mm/rad]
    pretension_n: float
    floor_n: float
    max_n: float

    def tensions_n(self, travels_mm: Array) -> Array:
        """Of travels ``(n, motors)``, where the energy over the bends is least."""
        given = travels_mm @ self.pulls.T
        weighted = self.shortenings.T * self.stiffness
        bends = np.linalg.solve(weighted @ self.shortenings + np.diag(self.bending), weighted @ given.T)
        found: Array = self.pretension_n + self.stiffness * (given - (self.shortenings @ bends).T)
        return found


def statics(text: str) -> Statics:
    """From the robot file of a trunk whose tendons run through all sections before their own."""
    arm: dict[str, Any] = yaml.safe_load(text)["robots"]["arm"]
    sections, tension = arm["geometry"]["sections"], arm["tension"]
    names = [f"s{s + 1}.t{t + 1}" for s, each in enumerate(sections) for t in range(len(each["angles_deg"]))]
    shortenings, pulls = np.zeros((len(names), 2 * len(sections))), np.zeros((len(names), len(arm["drives"])))
    for row, name in enumerate(names):
        own, tendon = int(name[1]) - 1, int(name[4:]) - 1
        angle = np.radians(sections[own]["angles_deg"][tendon])
        for before in range(own + 1):
            radius = sections[own]["radius_mm"][0]
            shortenings[row, 2 * before : 2 * before + 2] = radius * np.cos(angle), radius * np.sin(angle)
        for motor, drive in enumerate(arm["drives"].values()):
            pulls[row, motor] = drive["pulls"].get(name, 0.0)
    series = 1.0 / (1.0 / tension["tendon_n_per_mm"][0] + 1.0 / tension["spring_n_per_mm"][0])
    each_n_mm = zip(tension["bending_n_mm2"], sections, strict=True)
    bending = [stiff / section["length_mm"] for stiff, section in each_n_mm for _ in "xy"]
    limits = (tension["pretension_n"], tension["floor_n"], tension["max_n"])
    return Statics(pulls, shortenings, np.full(len(names), series), np.array(bending), *limits)


@dataclass
class Found:
    """Of all targets: least and greatest tension [N], how many were met, and how many left the limits."""

    targets: int = 0
    least_n: float = np.inf
    greatest_n: float = -np.inf
    met: int = 0
    wrong: int = 0


def search(targets: int, seed: int) -> Found:
    """Tips of random travels, each answered from the straight robot."""
    rng, found, robot = np.random.default_rng(seed), Found(), Robot("trunk")
    by_hand = statics((configs_folder() / "trunk.yaml").read_text(encoding="utf-8"))
    low, high = robot.limits.min, robot.limits.max
    while found.targets < targets:
        count = min(ROWS, targets - found.targets)
        tips = robot.fk(rng.uniform(low, high, (count, len(low)))).tip
        anywhere = rng.random(count) < 1.0 / ANYWHERE
        middle = np.array([0.0, 0.0, 320.0])
        tips[anywhere] = middle + rng.uniform(-320.0, 320.0, (int(anywhere.sum()), 3))
        answer = robot.ik(tips, seed=np.zeros(len(low)))
        tensions = by_hand.tensions_n(answer.actuation)
        found.targets += count
        found.met += int(answer.converged.sum())
        found.least_n = min(found.least_n, float(tensions.min()))
        found.greatest_n = max(found.greatest_n, float(tensions.max()))
        found.wrong += int(
            ((tensions < by_hand.floor_n - 1e-6) | (tensions > by_hand.max_n + 1e-6)).any(axis=1).sum()
        )
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", type=int)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    print(search(asked.targets, asked.seed))
