"""A robot on a live stream in virtual time, and the rows of paths."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import repeat
from typing import NamedTuple

import numpy as np

from contid.control.engine.cycle import OnEnd
from contid.control.engine.events import RunEvent
from contid.control.engine.messages import Rows
from contid.control.engine.virtual import VirtualProcess
from contid.control.tick.supervisor import Mode
from contid.kinematics.array import Array
from contid.robot_file.load import load_named, with_mock
from contid.targets import Target, Vec3

#: A row: when it arrives, and the tip [s, m].
Row = tuple[float, Vec3]
CIRCLE_M, CIRCLE_S = 0.01, 4.0


class Followed(NamedTuple):
    """What was commanded: times [s], axes and tips ``(ticks, ..)``, and ticks in which a limit bound."""

    time_s: Array
    axes: Array
    tip_m: Array
    limited: Array


class Run:
    """A robot on a live stream."""

    def __init__(self, name: str) -> None:
        loaded = with_mock(load_named(name))
        self.events: list[RunEvent] = []
        self.process = VirtualProcess(loaded, loaded.file.rate_hz, self, on_end=OnEnd.HOLD, attended=True)
        self.engine = self.process.engine
        self.config = self.engine.robots.configs[0]
        self.engine.arm()
        while not self.engine.robots.armed:
            self.tick()

    def write(self, values: list[float]) -> None:
        """See `contid.control.engine.cycle.Sink`."""

    def event(self, event: RunEvent) -> None:
        """See `contid.control.engine.cycle.Sink`."""
        self.events.append(event)

    @property
    def mode(self) -> Mode:
        return self.engine.robots.states[0].mode

    def tick(self) -> None:
        self.process.begin()
        self.process.turn()

    def row(self, tip_m: Vec3) -> None:
        target = Target(tip_m=self.config.frame.point_in_world(tip_m))
        self.engine.obey(Rows({self.config.name: target}), self.process.tick)

    def at_rest_on(self, tip_m: Vec3) -> None:
        self.row(tip_m)
        self.tick()
        while self.mode is not Mode.RUN:
            self.tick()

    def follow(self, rows: Sequence[Row], seconds: float, skips: Iterable[int] = repeat(0)) -> Followed:
        """The commands of a stream, from the tick in which the clock of its rows begins.

        Args:
            rows: by a clock that goes on while ticks are skipped.
            seconds: of the ticks that run.
            skips: how many ticks are skipped before each.
        """
        period_s, queue, axes, limited = self.config.period_s, list(rows), [], []
        before_all = self.process.skipped
        for k, skipped in zip(range(round(seconds / period_s)), skips, strict=False):
            self.process.tick += skipped
            self.process.skipped += skipped
            while queue and queue[0][0] <= (k + self.process.skipped - before_all) * period_s:
                self.row(queue.pop(0)[1])
            before = self.engine.robots.tallies[0].limited.total()
            self.tick()
            limited.append(float(self.engine.robots.tallies[0].limited.total() > before))
            assert self.mode is Mode.RUN
            axes.append(self.engine.robots.states[0].command)
        tips = [self.config.model.forward(each).tip_m for each in axes]
        times_s = np.array([k * period_s for k in range(len(axes))])
        return Followed(times_s, np.array(axes), np.array(tips), np.array(limited))

    def rates(self, followed: Followed) -> tuple[float, float, float]:
        """Greatest velocity, acceleration and jerk, as shares of the limits of the robot file."""
        h, limits = self.config.period_s, (self.config.velocity, self.config.acceleration, self.config.jerk)
        found = [
            float((np.abs(np.diff(followed.axes, order, axis=0)) / h**order / np.array(limit)).max())
            for order, limit in enumerate(limits, start=1)
        ]
        return found[0], found[1], found[2]


def middle(run: Run) -> Vec3:
    """The tip of a bent pose amid the reach of a robot."""
    model = run.config.model
    own = len(model.lower)
    shares = [0.5, 0.35, 0.45, 0.4, 0.5, 0.45, 0.4, 0.35][:own]
    axes = tuple(a + s * (b - a) for a, b, s in zip(model.lower, model.upper, shares, strict=True))
    return model.forward(axes).tip_m


def circle(run: Run, radius_m: float) -> Callable[[float], Vec3]:
    x, y, z = middle(run)

    def at(time_s: float) -> Vec3:
        angle = 2.0 * math.pi * time_s / CIRCLE_S
        return x + radius_m * (math.cos(angle) - 1.0), y + radius_m * math.sin(angle), z

    return at


def rows_of(
    at: Callable[[float], Vec3], rate_hz: float, jitter_s: float, lost: float = 0.0, seconds: float = 7.0
) -> Iterator[Row]:
    """Rows of a path; each is late by up to ``jitter_s``, a share is lost."""
    random, before_s = np.random.default_rng(7), 0.0
    for k in range(int(seconds * rate_hz)):
        late_s = float(random.uniform(0.0, jitter_s))
        if random.uniform() >= lost:
            before_s = max(before_s, 0.0031 + k / rate_hz + late_s)
            yield before_s, at(k / rate_hz)
