"""Mechanical faults of one axis: what they do to its commands, its body and its readings."""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.hal import DeviceKind
from tests.campaign.bodies.plants import Axes, Plant, Values

SHAFTS: Final = (
    "horn slipped", "wrong pinion", "wrong sign", "frozen encoder", "jumping encoder", "stuck",
    "swapped channels", "backlash", "friction x3", "slow",
)  # fmt: skip
CHAMBERS: Final = (
    "hose off", "leak", "stuck", "swapped channels", "frozen encoder", "jumping encoder", "wrong sign",
    "wrong pinion",
)  # fmt: skip


@dataclass
class Damage:
    """One fault of one axis."""

    kind: str
    axis: int
    other: int
    size: float
    begin: float = 0.0
    shown: float = 0.0

    def goals(self, goals: Values) -> Values:
        if self.kind == "swapped channels":
            goals[1, [self.axis, self.other]] = goals[1, [self.other, self.axis]]
        return goals

    def start(self, plant: Plant) -> None:
        self.begin = self.shown = float(plant.at[1, self.axis])
        if self.kind == "stuck":
            plant.held[self.axis] = True
        if self.kind == "slow":
            plant.top[1, self.axis] = self.size

    def seen(self, value: float, since_s: float) -> float:
        share = {
            "horn slipped": 1.0 / 3.0, "wrong pinion": self.size, "wrong sign": -1.0, "frozen encoder": 0.0
        }.get(self.kind)  # fmt: skip
        if share is not None:
            return self.begin + share * (value - self.begin)
        if self.kind in ("hose off", "leak"):
            lost = 1.0 if self.kind == "hose off" else self.size
            return value * (1.0 - lost * (1.0 - float(np.exp(-since_s / 0.05))))
        if self.kind == "jumping encoder":
            return value + self.size
        if self.kind in ("backlash", "friction x3"):
            self.shown = min(max(self.shown, value - self.size), value + self.size)
            return self.shown
        return value


def damage(kind: str, axes: Axes, draw: random.Random) -> Damage:
    """A fault of a random axis that can have it."""
    chamber = kind in ("hose off", "leak")
    able = [
        i for i, each in enumerate(axes.kinds) if (each is DeviceKind.REGULATOR) == chamber or kind in SHAFTS
    ]
    axis = draw.choice(able)
    same = [i for i, each in enumerate(axes.kinds) if i != axis and each is axes.kinds[axis]] or [axis]
    counts = float(axes.counts[axis])
    top = axes.config.velocity[axis] / axes.config.responses[axis].unit
    size = {
        "wrong pinion": draw.choice([draw.uniform(0.4, 0.75), draw.uniform(1.35, 2.5)]),
        "leak": draw.uniform(0.1, 1.0),
        "jumping encoder": draw.choice([-1, 1]) * counts * draw.uniform(1.0, 30.0),
        "backlash": counts * draw.uniform(1.0, 3.0),
        "friction x3": counts * draw.uniform(1.0, 2.0),
        "slow": top * draw.uniform(0.05, 0.5),
    }.get(kind, 0.0)
    return Damage(kind, axis, draw.choice(same), size)


def faults_of(axes: Axes) -> tuple[str, ...]:
    kinds = set(axes.kinds)
    return tuple(
        dict.fromkeys(
            (
                *(SHAFTS if kinds - {DeviceKind.REGULATOR} else ()),
                *(CHAMBERS if DeviceKind.REGULATOR in kinds else ()),
            )
        )
    )
