"""The watch of the bodies beside a plant: runs with a fault, and runs of sound bodies.

A fault counts once the damaged axis is measured farther from its sound twin than 2 mm, 0.05 bar or 10
degrees within ten seconds; it shows from a tenth of that on (in an axis that stands, most do not show). It
is found in time when that is by then, or within 0.3 s of when it shows.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from contid.control.engine.cycle import Timing
from contid.control.engine.watch.body_watch import BodyWatch
from contid.control.engine.watch.path_pace import BEGIN
from contid.control.tick.faults import Fault
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.hal import Sample
from tests.campaign.bodies.damages import damage
from tests.campaign.bodies.motions import motion
from tests.campaign.bodies.plants import RATE_HZ, Axes, Plant


class Watched:
    """`BodyWatch` of one robot, between the commands and the readings of a plant."""

    def __init__(self, axes: Axes) -> None:
        self._config = axes.config
        self.fault, self.message, self.watched_s = Fault.NONE, "", 0.0
        self._samples: dict[str, Sample] = {}
        self._state = RobotState(Mode.RUN, enabled=True)
        robots: Any = SimpleNamespace(configs=(axes.config,), states=[self._state], fail=self._fail)
        exchange: Any = SimpleNamespace(
            samples=self._samples,
            effort_shares={},
            samples_of=lambda config: tuple(self._samples[axis] for axis in config.axes),
        )
        self._watch = BodyWatch(robots, exchange)
        #: Greatest distance of an axis from its range as a share of its tolerance, and ticks beyond a half.
        self.behind, self.slowed = 0.0, 0

    def _fail(self, index: int, fault: Fault, message: str, now_s: float) -> None:
        self.fault, self.message = fault, message

    def tick(self, tick: int, device: tuple[float, ...], values: Sequence[float]) -> None:
        """The readings before a tick, then its command."""
        now_s = self.watched_s = tick / RATE_HZ
        for axis, value in zip(self._config.axes, values, strict=True):
            self._samples[axis] = Sample(value, now_s, True, 0.0)
        self._watch.before({}, Timing(tick, 0, now_s), now_s)
        self.behind = max(self.behind, self._watch.behind)
        self.slowed += self._watch.behind >= BEGIN
        outcome: Any = SimpleNamespace(device=device, state=self._state)
        self._watch.after([outcome], {}, now_s)


@dataclass(frozen=True)
class Found:
    """Times since the begin of a fault [s]: when it showed, counted, and was found; None for never."""

    shown_s: float | None
    counted_s: float | None
    found_s: float | None

    @property
    def in_time(self) -> bool:
        return (
            self.found_s is not None
            and self.found_s <= max(self.counted_s or 0.0, (self.shown_s or 0.0) + 0.3) + 1e-9
        )


def run(axes: Axes, draw: random.Random, seconds: float, kind: str | None) -> tuple[Found, Watched, float]:
    """One run, with a fault of a kind from a random time on, or none; and when a fault was reported [s]."""
    moves, config = motion(axes.config, draw), axes.config
    device = config.transmission.to_device(next(moves))
    plant, watched = Plant(axes, draw, np.array(device)), Watched(axes)
    harm = None if kind is None else damage(kind, axes, draw)
    onset = int(draw.uniform(1.0, 4.0) * RATE_HZ) if harm else -1
    shown = counted = found = None
    tick = 0
    values = plant.read()
    for tick in range(int(seconds * RATE_HZ)):
        watched.tick(tick, device, values[1].tolist())
        if watched.fault is not Fault.NONE:
            found = (tick - onset) / RATE_HZ
            break
        goals = np.tile(np.array(device), (2, 1))
        if harm is not None and tick >= onset:
            if tick == onset:
                harm.start(plant)
            goals = harm.goals(goals)
        plant.advance(goals)
        values = plant.read()
        if harm is not None and tick >= onset:
            since_s = (tick + 1 - onset) / RATE_HZ
            values[1, harm.axis] = harm.seen(float(values[1, harm.axis]), since_s)
            share = float(np.max(np.abs(values[1] - values[0]) / axes.counts))
            shown = since_s if shown is None and share >= 0.1 else shown
            counted = since_s if counted is None and share >= 1.0 else counted
        device = config.transmission.to_device(next(moves))
    if harm is not None and found is not None and counted is None:
        counted = found  # found before it counted
    return Found(shown, counted, found), watched, tick / RATE_HZ


def run_sound(axes: Axes, draw: random.Random, seconds: float, count: int) -> list[Watched]:
    """Sound bodies of one robot, computed as one plant with all their axes, until the time or an alarm."""
    many = replace(
        axes,
        kinds=axes.kinds * count,
        counts=np.tile(axes.counts, count),
        tops=np.tile(axes.tops, count),
        pushes=np.tile(axes.pushes, count),
    )
    to_device, size = axes.config.transmission.to_device, len(axes.kinds)
    moves = [motion(axes.config, draw) for _ in range(count)]
    bodies = [Watched(axes) for _ in range(count)]
    device = [to_device(next(move)) for move in moves]
    plant = Plant(many, draw, np.concatenate(device), twins=1)
    for tick in range(int(seconds * RATE_HZ)):
        values = plant.read()[0].tolist()
        for k, body in enumerate(bodies):
            if body.fault is Fault.NONE:
                body.tick(tick, device[k], values[k * size : (k + 1) * size])
        plant.advance(np.concatenate(device)[None])
        device = [to_device(next(move)) for move in moves]
    return bodies
