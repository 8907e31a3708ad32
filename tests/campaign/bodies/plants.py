"""Plants of sound and damaged robots, which share nothing with `contid.control.tick.follow`.

Servos are second-order, regulators first-order, the set-point of a motor goes on along its commands with
limited acceleration, and its shaft follows it by a controller; all are integrated in steps of 2 ms, with dead
times and readings that are late by 2 to 18 ms together, anew in every tick, with noise and steps of the
encoder. Their numbers are those of the simulated devices, each wrong by up to 20 %.
"""

from __future__ import annotations

import random
from collections import deque
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.hal import DeviceKind, load_driver
from contid.robot_file.base import Quantity
from contid.robot_file.load import LoadedFile, with_mock
from contid.units import BAR

RATE_HZ: Final = 100.0
STEP_S: Final = 0.002
STEPS: Final = 5
#: Deviation that counts, in m, Pa and rad.
COUNTS: Final = {Quantity.LENGTH: 2e-3, Quantity.PRESSURE: 0.05 * BAR, Quantity.ANGLE: 0.1745}
Values = NDArray[np.float64]


@dataclass(frozen=True)
class Axes:
    """What the plants need of the axes of a robot; arrays by axis, in the unit of the device."""

    config: RobotConfig
    kinds: tuple[DeviceKind, ...]
    counts: Values
    tops: Values
    pushes: Values


def axes_of(loaded: LoadedFile) -> list[Axes]:
    wired: dict[str, Any] = {axis: options for bus in loaded.buses.values() for axis, options in bus.axes}
    kinds = {
        axis: load_driver(bus.driver).kind(options)
        for bus in loaded.buses.values()
        for axis, options in bus.axes
    }
    out = []
    for config in build_robot_configs(with_mock(loaded), RATE_HZ):
        units = np.array([each.unit for each in config.responses])
        counts = np.array([COUNTS[quantity] for quantity in config.quantities]) / units
        tops = np.array([each.top for each in config.responses])
        limits = [getattr(wired[axis], "acceleration_deg_s2", np.inf) for axis in config.axes]
        own = tuple(kinds[axis] for axis in config.axes)
        out.append(Axes(config, own, counts, tops, np.deg2rad(limits)))
    return out


class Plant:
    """Devices of one robot, and what is read of them; row 0 sound, row 1 damaged if there is one."""

    def __init__(self, axes: Axes, draw: random.Random, start: Values, twins: int = 2) -> None:
        n = len(start)
        rng = self._rng = np.random.default_rng(draw.randrange(2**32))
        off = lambda: rng.uniform(0.8, 1.2, n)  # noqa: E731
        kinds = np.array([each.value for each in axes.kinds])
        self._servo, self._motor = kinds == "servo", kinds == "motor"
        tau = np.select([self._servo, self._motor], [0.015, 0.008], 0.050)
        self._tau = tau * off()
        self._push = axes.pushes
        #: Gain of the position controller of a motor, and what its speed is short of the asked one.
        self._stiff, self._short = 20.0 * off(), 1.0 + 0.2 * (off() - 1.0)
        slow = np.where(np.isfinite(axes.tops), axes.tops, np.inf)
        self.top = np.tile(slow * off().clip(1.0), (twins, 1))
        self._noise = np.select([self._servo, self._motor], [4.6e-4, 0.0], 0.003 * BAR) * off()
        self._grain = np.select([self._servo, self._motor], [1.53e-3, 1.3e-3], 73.0)
        self.at = np.tile(start, (twins, 1))
        self.speed = np.zeros((twins, n))
        self._inner = self.at.copy()
        self._set_speed, self._set_push = np.zeros((twins, n)), np.zeros((twins, n))
        self._rate = np.zeros((twins, n))
        self._last = self.at.copy()
        self._since_s = 0.0
        self._past: deque[Values] = deque([self.at.copy()] * 10, maxlen=10)
        self._commands: deque[Values] = deque([self.at.copy()] * 10, maxlen=10)
        self.held = np.zeros(n, dtype=bool)

    def advance(self, goals: Values) -> None:
        """One period with goals, an array of a row for each twin."""
        late = int(self._rng.integers(1, 4))
        for step in range(STEPS):
            self._commands.append(goals if step >= late - 1 else self._commands[-1])
            goal = self._commands[-1]
            if step == late - 1:
                self._rate, self._last, self._since_s = (goal - self._last) * RATE_HZ, goal, 0.0
            self._follow_line(goal)
            wish = np.where(
                self._motor,
                self._short * (self._set_speed + 0.008 * self._set_push)
                + self._stiff * (self._inner - self.at),
                (goal - self._inner) / self._tau,
            )
            wish = np.clip(wish, -self.top, self.top)
            slow = np.where(self._motor, 1.0 - np.exp(-STEP_S / self._tau), 1.0)
            speed = self.speed + slow * (wish - self.speed)
            speed[1:, self.held] = 0.0
            self.speed = speed
            self._inner = self._inner + STEP_S * np.where(self._motor, self._set_speed, speed)
            # A servo has a second, faster lag; the gear train of a motor and a chamber have none.
            follow = np.where(self._servo, 1.0 - np.exp(-STEP_S / 0.008), 1.0)
            new = np.where(self._motor, self.at + STEP_S * speed, self.at + follow * (self._inner - self.at))
            new[1:, self.held] = self.at[1:, self.held]
            self.at = new
            self._past.append(new)

    def _follow_line(self, goal: Values) -> None:
        """The set-point of a motor board: on along the commands for two periods, within its acceleration."""
        moving = self._since_s < 2.0 / RATE_HZ - 1e-9
        rate = self._rate if moving else np.zeros_like(self._rate)
        self._since_s += STEP_S
        way = goal + rate * self._since_s - self._inner - rate * STEP_S
        push = np.where(self._motor, self._push, 1.0)
        # Beside a stream it catches up with no more than it can brake while the stream brakes.
        brake = push / 6.0 if moving else push
        braking = np.minimum(np.sqrt(2.0 * brake * np.abs(way)), np.abs(way) / (2.0 * STEP_S))
        wish = rate + np.sign(way) * braking
        change = np.clip(wish - self._set_speed, -push * STEP_S, push * STEP_S)
        self._set_speed, self._set_push = self._set_speed + change, change / STEP_S

    def read(self) -> Values:
        """Readings of both twins, late by 0 to 12 ms, with the same noise."""
        old = self._past[-1 - int(self._rng.integers(0, 7))]
        noise = self._rng.normal(0.0, 1.0, old.shape[1]) * self._noise
        return np.asarray(np.round((old + noise) / self._grain) * self._grain)
