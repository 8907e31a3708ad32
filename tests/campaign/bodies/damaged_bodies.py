"""Bodies that are damaged at a random time, and sound ones, against the watch of the bodies.

``python -m tests.campaign.bodies.damaged_bodies [--onsets N] [--hours H] [--robot NAME ...]``. The plants
here share nothing with `contid.control.tick.follow`: servos are second-order, regulators first-order, the
set-point of a motor goes on along its commands with limited acceleration, and its shaft follows it by a
controller; all are integrated in steps of 2 ms, with dead times and readings that are late by 2 to 18 ms
together, anew in every tick, with noise and steps of the encoder. Their numbers are those of the simulated
devices, each wrong by up to 20 %. Motions are random ones within the file's rates.

A fault counts once the damaged axis is measured farther from its sound twin than 2 mm, 0.05 bar or 10
degrees within ten seconds; it shows from a tenth of that on (in an axis that stands, most do not show). It
is found in time when that is by then, or within 0.3 s of when it shows.
"""

from __future__ import annotations

import argparse
import random
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from contid.control.engine.cycle import Timing
from contid.control.engine.watch.body_watch import BodyWatch
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.hal import DeviceKind, Sample, load_driver
from contid.robot_file.base import Quantity
from contid.robot_file.load import LoadedFile, find_robot_file, load_robot_file, with_mock
from contid.units import BAR

RATE_HZ: Final = 100.0
STEP_S: Final = 0.002
STEPS: Final = 5
ROBOTS: Final = (
    "cbha", "chain", "finger", "ftdcr_v4", "hand",
    "stiffflop1", "stiffflop2", "tendon3", "trirack", "trirack2",
)  # fmt: skip
#: Deviation that counts, in m, Pa and rad.
COUNTS: Final = {Quantity.LENGTH: 2e-3, Quantity.PRESSURE: 0.05 * BAR, Quantity.ANGLE: 0.1745}
SHAFTS: Final = (
    "horn slipped", "wrong pinion", "wrong sign", "frozen encoder", "jumping encoder", "stuck",
    "swapped channels", "backlash", "friction x3", "slow",
)  # fmt: skip
CHAMBERS: Final = (
    "hose off", "leak", "stuck", "swapped channels", "frozen encoder", "jumping encoder", "wrong sign",
    "wrong pinion",
)  # fmt: skip
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


def motion(config: RobotConfig, draw: random.Random) -> Iterator[tuple[float, ...]]:
    """Random commands [m, Pa or rad] within the rates: rounded trapezoids at any speed, and standstills."""

    def one(axis: int) -> Iterator[float]:
        limit = config.limits[axis]
        at = draw.uniform(limit.lower, limit.upper)
        while True:
            goal = draw.uniform(limit.lower, limit.upper)
            if draw.random() < 0.5:  # a short way
                goal = min(max(at + 0.1 * (goal - at), limit.lower), limit.upper)
            speed = config.velocity[axis] * 10.0 ** draw.uniform(-1.7, 0.0)
            push = config.acceleration[axis]
            way, sign = abs(goal - at), 1.0 if goal > at else -1.0
            ramp = min(speed / push, (way / push) ** 0.5)
            top = push * ramp
            cruise = (way - top * ramp) / top if top > 0.0 else 0.0
            whole = 2.0 * ramp + cruise
            for k in range(1, int(whole * RATE_HZ) + 1):
                t = k / RATE_HZ
                if t < ramp:
                    done = 0.5 * push * t * t
                elif t < ramp + cruise:
                    done = 0.5 * top * ramp + top * (t - ramp)
                else:
                    done = way - 0.5 * push * max(whole - t, 0.0) ** 2
                yield at + sign * done
            at = goal
            for _ in range(int(draw.expovariate(1.0) * RATE_HZ)):
                yield at

    def smooth(axis: int) -> Iterator[float]:
        """The same with limited jerk: the mean of the ticks in which the acceleration may rise."""
        source = one(axis)
        newest: deque[float] = deque([next(source)], maxlen=max(round(rises_s[axis] * RATE_HZ), 1))
        while True:
            yield sum(newest) / len(newest)
            newest.append(next(source))

    rises_s = [push / jerk for push, jerk in zip(config.acceleration, config.jerk, strict=True)]
    axes = [smooth(axis) for axis in range(len(config.axes))]
    while True:
        yield tuple(next(axis) for axis in axes)


class Plant:
    """Devices of one robot, and what is read of them; row 0 sound, row 1 damaged."""

    def __init__(self, axes: Axes, draw: random.Random, start: Values) -> None:
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
        self.top = np.tile(slow * off().clip(1.0), (2, 1))
        self._noise = np.select([self._servo, self._motor], [4.6e-4, 0.0], 0.003 * BAR) * off()
        self._grain = np.select([self._servo, self._motor], [1.53e-3, 1.3e-3], 73.0)
        self.at = np.tile(start, (2, 1))
        self.speed = np.zeros((2, n))
        self._inner = self.at.copy()
        self._set_speed, self._set_push = np.zeros((2, n)), np.zeros((2, n))
        self._rate = np.zeros((2, n))
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
            speed[1, self.held] = 0.0
            self.speed = speed
            self._inner = self._inner + STEP_S * np.where(self._motor, self._set_speed, speed)
            # A servo has a second, faster lag; the gear train of a motor and a chamber have none.
            follow = np.where(self._servo, 1.0 - np.exp(-STEP_S / 0.008), 1.0)
            new = np.where(self._motor, self.at + STEP_S * speed, self.at + follow * (self._inner - self.at))
            new[1, self.held] = self.at[1, self.held]
            self.at = new
            self._past.append(new)

    def _follow_line(self, goal: Values) -> None:
        """The set-point of a motor board: on along the commands for two periods, within its acceleration."""
        moving = self._since_s < 2.0 / RATE_HZ - 1e-9
        rate = self._rate if moving else np.zeros_like(self._rate)
        self._since_s += STEP_S
        way = goal + rate * self._since_s - self._inner - rate * STEP_S
        push = np.where(self._motor, self._push, 1.0)
        braking = np.minimum(np.sqrt(2.0 * push * np.abs(way)), np.abs(way) / (2.0 * STEP_S))
        wish = rate + np.sign(way) * braking
        change = np.clip(wish - self._set_speed, -push * STEP_S, push * STEP_S)
        self._set_speed, self._set_push = self._set_speed + change, change / STEP_S

    def read(self) -> Values:
        """Readings of both twins, late by 0 to 12 ms, with the same noise."""
        old = self._past[-1 - int(self._rng.integers(0, 7))]
        noise = self._rng.normal(0.0, 1.0, old.shape[1]) * self._noise
        return np.asarray(np.round((old + noise) / self._grain) * self._grain)


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


class Watched:
    """`BodyWatch` of one robot, between the commands and the readings of a plant."""

    def __init__(self, axes: Axes) -> None:
        self._config = axes.config
        self.fault, self.message = Fault.NONE, ""
        self._samples: dict[str, Sample] = {}
        robots: Any = SimpleNamespace(configs=(axes.config,), fail=self._fail)
        exchange: Any = SimpleNamespace(
            samples=self._samples,
            samples_of=lambda config: tuple(self._samples[axis] for axis in config.axes),
        )
        self._watch = BodyWatch(robots, exchange)
        self._state = RobotState(Mode.RUN, enabled=True)

    def _fail(self, index: int, fault: Fault, message: str, now_s: float) -> None:
        self.fault, self.message = fault, message

    def tick(self, tick: int, device: tuple[float, ...], values: Sequence[float]) -> None:
        """The readings before a tick, then its command."""
        now_s = tick / RATE_HZ
        for axis, value in zip(self._config.axes, values, strict=True):
            self._samples[axis] = Sample(value, now_s, True, 0.0)
        self._watch.before({}, Timing(tick, 0, now_s), now_s)
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--onsets", type=int, default=20)
    parser.add_argument("--hours", type=float, default=0.1)
    parser.add_argument("--robot", nargs="*", default=ROBOTS)
    parser.add_argument("--show", action="store_true", help="print what was found late or never")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    total: Counter[str] = Counter()
    alarms, sound_s = 0, 0.0
    for name in asked.robot:
        axes = axes_of(load_robot_file(find_robot_file(name)))[0]
        row = []
        for kind in faults_of(axes):
            draw = random.Random(f"{asked.seed} {name} {kind}")
            runs = [run(axes, draw, 14.0, kind)[0] for _ in range(asked.onsets)]
            counted = [each for each in runs if each.counted_s is not None]
            good = sum(each.in_time for each in counted)
            total[kind] += len(counted)
            total[f"{kind}: in time"] += good
            row.append(f"{kind} {good}/{len(counted)}")
            missed = [each for each in counted if not each.in_time]
            if missed and asked.show:
                print(name, kind, missed)
        print(f"{name}: {', '.join(row)}", flush=True)
        draw, left_s = random.Random(f"{asked.seed} {name}"), asked.hours * 3600.0
        while left_s > 0.0:
            _, watched, lasted_s = run(axes, draw, min(left_s, 300.0), None)
            left_s, sound_s = left_s - max(lasted_s, 1.0), sound_s + lasted_s
            if watched.fault is not Fault.NONE:
                alarms += 1
                print(f"{name}: false alarm {watched.fault.name}: {watched.message}", flush=True)
    kinds = [kind for kind in total if not kind.endswith(": in time")]
    for kind in kinds:
        print(f"{kind}: {total[f'{kind}: in time']} of {total[kind]} in time")
    whole, found = sum(total[kind] for kind in kinds), sum(total[f"{kind}: in time"] for kind in kinds)
    share, hours = found / max(whole, 1), sound_s / 3600.0
    print(f"{found} of {whole} in time ({share:.2%}); {alarms} false alarms in {hours:.2f} h")


if __name__ == "__main__":
    main()
