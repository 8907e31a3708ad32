"""Random live streams: rows that jump, stop, restart, change their rate, go back, turn back, come in bursts.

``python -m tests.campaign.live.random_streams [--streams N] [--seed S] [--robots A,B] [--minutes M]
[--away TIMES]``: exit 1 on a violation; tips some times as far away leave the reach. Every stream begins
with the robot at rest amid its reach and is a function of its number.
What follows it is the follower of live rows and the tick of the robot, as in the engine, in their own time;
devices and buses are left out. Judged from the commands alone:

* position, velocity, acceleration and jerk of every axis, and tensions of tendons, within the robot file;
* after the last row the robot comes to rest, with its tip on that row where the model answers it there.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import repeat
from typing import Final, NamedTuple

import numpy as np

from contid.control.engine.live.target_follower import TargetFollower
from contid.control.tick.config import RobotConfig
from contid.control.tick.robot_tick import tick
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.kinematics.array import Array
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.base import Quantity
from contid.targets import Actuation, Target, Vec3, vec3
from contid.units import LIMIT_TOLERANCE_M
from tests.control.engine.streamed import Row, Run

ROBOTS: Final = ("finger", "cbha", "trirack", "trirack2", "stiffflop1", "stiffflop2", "tendon3", "ftdcr_v4")
#: Rows come for this time, and the robot has to rest this time after the last [s].
ROWS_S, REST_S = 1.0, 15.0
#: Ticks without a motion that count as rest.
RESTS: Final = 5
#: A limit is exceeded beyond this share of it; a tip is on its row within this distance [m].
OVER: Final = 1.0 + 1e-6
ON_ROW_M: Final = 1e-6
#: A tip is within reach, and axes rest, within this distance [m], pressures within this [Pa].
REACHED_M: Final = 1e-9
STANDS: Final = {Quantity.LENGTH: 1e-12, Quantity.PRESSURE: 1e-3}
#: Share of each tendon's travel in the middle of the reach.
TENDONS: Final = (0.6, 0.45, 0.45)


class Stage(NamedTuple):
    """A robot at rest in the middle of its reach, before a stream."""

    config: RobotConfig
    state: RobotState
    tip_m: Vec3
    middle: Array
    now_s: float

    def tip_at(self, shares: Array) -> Vec3:
        """The tip at shares of the ranges of the axes, nearer to the middle where limits of the body bind."""
        model = self.config.model
        low, high = np.array(model.lower), np.array(model.upper)
        shares = np.clip(shares, 0.0, 1.0)
        for pull in (1.0, 0.8, 0.6, 0.4, 0.2):
            axes = tuple((low + (self.middle + pull * (shares - self.middle)) * (high - low)).tolist())
            if isinstance(model, TendonModel):
                axes = model.inverse(Target(actuation=axes), axes).actuation
            tip_m = model.forward(axes).tip_m
            answer = model.inverse(Target(tip_m=tip_m), axes)
            if not answer.limited_by and answer.residual_m < REACHED_M:
                break
        return tip_m


def staged(name: str) -> Stage:
    """The stage of a shipped robot."""
    run = Run(name)
    model = run.config.model
    own = len(model.lower)
    shares = np.array(TENDONS * (own // 3) if isinstance(model, TendonModel) else (0.5, 0.35, 0.45) * 3)[:own]
    robots = run.engine.robots
    stage = Stage(run.config, robots.states[0], (0.0, 0.0, 0.0), shares, 0.0)
    tip_m = stage.tip_at(shares)
    run.at_rest_on(tip_m)
    while any(robots.states[0].increments):
        run.tick()
    return stage._replace(tip_m=tip_m, state=robots.states[0], now_s=run.process.tick * run.config.period_s)


def rows_of(stage: Stage, number: int) -> list[Row]:
    """The rows of a stream: when each arrives, from 0 on, and its tip."""
    random = np.random.default_rng(number)
    axes = len(stage.middle)
    center, at_s, now_s, rows = stage.middle.copy(), 0.0, 0.0, list[Row]()
    rate_hz = float(random.choice([10.0, 20.0, 50.0, 100.0, 200.0, 500.0]))
    size = float(random.choice([0.0, 0.005, 0.02, 0.1, 0.3]))
    sizes = size * random.uniform(-1.0, 1.0, axes)
    pulse = 2.0 * math.pi / random.uniform(0.3, 4.0)
    phases = random.uniform(0.0, 2.0 * math.pi, axes)
    jitter_s, lost = float(random.choice([0.0, 0.002, 0.005, 0.02])), float(random.choice([0.0, 0.01, 0.2]))
    before_s = 0.0
    while now_s < ROWS_S:
        for _ in range(int(random.integers(1, max(2, int(0.5 * rate_hz))))):
            shares = center + sizes * (np.sin(pulse * at_s + phases) - np.sin(phases))
            if random.uniform() >= lost:
                before_s = max(before_s, now_s + float(random.uniform(0.0, jitter_s)))
                rows.append((before_s, stage.tip_at(shares)))
            now_s, at_s = now_s + 1.0 / rate_hz, at_s + 1.0 / rate_hz
        match int(random.integers(8)):
            case 0:  # a jump, far or near
                center = center + float(random.choice([0.003, 0.03, 0.3])) * random.uniform(-1.0, 1.0, axes)
                center = np.clip(center, 0.3, 0.7)
            case 1:  # a stop; the path goes on after it where it was
                now_s += float(random.uniform(0.02, 0.6))
            case 2:  # rows that were not sent: the path went on meanwhile
                gap_s = float(random.uniform(0.02, 0.6))
                now_s, at_s = now_s + gap_s, at_s + gap_s
            case 3:
                rate_hz = min(2.0 * rate_hz, 1000.0)
            case 4:
                rate_hz = max(0.5 * rate_hz, 5.0)
            case 5:  # the producer begins again from an earlier time
                at_s -= float(random.uniform(0.0, at_s))
            case 6:  # rows that waited arrive at once
                late_s = float(random.uniform(0.0, 0.3))
                rows = [
                    (max(each_s, now_s) if each_s > now_s - late_s else each_s, tip) for each_s, tip in rows
                ]
            case _:  # the path turns back
                pulse, phases = -pulse, phases + 2.0 * pulse * at_s
        before_s = max(before_s, now_s)
    return rows or [(0.0, stage.tip_m)]  # all were lost


def away(stage: Stage, rows: list[Row], times: float) -> list[Row]:
    """The rows with tips some times as far from where the robot stands."""
    if times == 1.0:
        return rows
    at_m = np.array(stage.tip_m)
    return [(time_s, vec3((at_m + times * (np.array(tip_m) - at_m)).tolist())) for time_s, tip_m in rows]


def skips_of(number: int) -> Iterator[int]:
    """How many ticks a busy machine skips before each tick of a stream: none, single ones, or stalls."""
    random = np.random.default_rng(number)
    between, longest = int(random.choice([2, 5, 30, 100])), int(random.choice([1, 3, 10, 40]))
    while True:
        yield from (0 for _ in range(int(random.integers(1, 2 * between))))
        yield int(random.integers(1, longest + 1))


def followed(stage: Stage, rows: list[Row], skips: Iterator[int]) -> tuple[list[Actuation], RobotState]:
    """The commands of every tick until the robot rests after the last row, and the state then.

    Args:
        stage: where the robot stands.
        rows: of the stream, at times that go on while ticks are skipped.
        skips: how many ticks are skipped before each.
    """
    config, state = stage.config, stage.state
    follower = TargetFollower(config)
    follower.put(_target(config, stage.tip_m), stage.now_s, state)
    commands, queue, rests = [state.command], rows[::-1], 0
    ends_s = rows[-1][0] + REST_S
    count, skipped_s = 0, 0.0
    while rests < RESTS and count * config.period_s < ends_s:
        time_s = count * config.period_s
        now_s = stage.now_s + time_s
        skipped_s += next(skips) * config.period_s
        while queue and queue[-1][0] <= time_s + skipped_s:
            follower.put(_target(config, queue.pop()[1]), now_s, state, skipped_s)
        target = follower.target(now_s, state, skipped_s)
        state = tick(config, state, now_s, (), target, live=True).state
        commands.append(state.command)
        still = _still(config, commands) and follower.resting
        rests = rests + 1 if still and not queue and state.mode is Mode.RUN else 0
        count += 1
    return commands, state


def _still(config: RobotConfig, commands: list[Actuation]) -> bool:
    most = STANDS[config.quantity]
    return all(abs(new - old) <= most for new, old in zip(commands[-1], commands[-2], strict=True))


def _target(config: RobotConfig, tip_m: Vec3) -> Target:
    return Target(tip_m=config.frame.point_in_world(tip_m))


def violations(stage: Stage, rows: list[Row], skips: Iterator[int] | None = None) -> dict[str, float]:
    """What a stream violated, by name, and by how many times the limit; ``skips``: of `followed`."""
    config = stage.config
    commands, state = followed(stage, rows, repeat(0) if skips is None else skips)
    first = commands[0]
    axes, h, found = np.array([first, first, *commands]), config.period_s, dict[str, float]()
    rates = {"velocity": config.velocity, "acceleration": config.acceleration, "jerk": config.jerk}
    for order, (what, most) in enumerate(rates.items(), start=1):
        share = float((np.abs(np.diff(axes, order, axis=0)) / h**order / np.array(most)).max())
        if not share <= OVER:
            found[what] = share
    model = config.model
    own = axes[:, : len(model.lower)]
    outside = float(np.maximum(np.array(model.lower) - own, own - np.array(model.upper)).max())
    if not outside <= 2.0 * LIMIT_TOLERANCE_M:
        found["range"] = outside
    if isinstance(model, TendonModel):
        over_m = max(float(model.excess(tuple(each)).max()) for each in own[:: max(1, len(own) // 200)])
        if not over_m <= 2.0 * LIMIT_TOLERANCE_M:
            found["tension"] = over_m
    if state.mode is not Mode.RUN:
        found[f"mode {state.mode.name} {state.message}"] = 1.0
        return found
    if not _still(config, commands):
        found["no rest"] = 1.0
        return found
    answer = model.inverse(Target(tip_m=rows[-1][1]), state.command)
    off_m = math.dist(model.forward(state.command).tip_m, rows[-1][1]) - answer.residual_m
    if not off_m <= ON_ROW_M:
        found["off the last row"] = off_m
    return found


@dataclass
class StreamTally:
    """Streams and what they violated: counts, worst shares and numbers, by robot and violation."""

    streams: Counter[str] = field(default_factory=Counter)
    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    worst: dict[tuple[str, str], float] = field(default_factory=dict)
    numbers: dict[tuple[str, str], list[int]] = field(default_factory=dict)

    def add(self, robot: str, number: int, found: dict[str, float]) -> None:
        """One stream."""
        self.streams[robot] += 1
        for what, share in found.items():
            key = robot, what
            self.counts[key] += 1
            self.worst[key] = max(self.worst.get(key, 0.0), share)
            self.numbers.setdefault(key, []).append(number)

    def table(self) -> str:
        """For a person."""
        lines = [f"{robot}: {count} streams" for robot, count in self.streams.items()]
        for (robot, what), count in self.counts.items():
            first = ", ".join(map(str, self.numbers[robot, what][:8]))
            lines.append(f"{robot}: {what}: {count} (worst {self.worst[robot, what]:.3g}; streams {first})")
        return "\n".join([*lines, f"{self.streams.total()} streams, {self.counts.total()} violations"])


def campaign(
    robots: tuple[str, ...],
    streams: int,
    seed: int,
    progress: Callable[[StreamTally], None] = lambda tally: None,
    times: float = 1.0,
    skips: bool = False,
) -> StreamTally:
    """Follow streams in turns of the robots.

    Args:
        robots: names of shipped ones.
        streams: how many.
        seed: of their numbers.
        progress: called after each.
        times: how many times as far from where the robots stand the tips are.
        skips: ticks are skipped.
    """
    tally, stages = StreamTally(), {name: staged(name) for name in robots}
    for number in range(seed * 1_000_000, seed * 1_000_000 + streams):
        name = robots[number % len(robots)]
        stage = stages[name]
        rows = away(stage, rows_of(stage, number), times)
        tally.add(name, number, violations(stage, rows, skips_of(number) if skips else None))
        progress(tally)
    return tally


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign.live.random_streams", description="Random live streams."
    )
    parser.add_argument("--streams", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--robots", default=",".join(ROBOTS))
    parser.add_argument("--minutes", type=float, default=math.inf)
    parser.add_argument("--away", type=float, default=1.0)
    parser.add_argument("--skips", action="store_true", help="ticks are skipped, as on a busy machine")
    asked = parser.parse_args()
    ends_s, shown = time.monotonic() + 60.0 * asked.minutes, [time.monotonic()]
    newest = [StreamTally()]

    def progress(tally: StreamTally) -> None:
        newest[0] = tally
        now_s = time.monotonic()
        if now_s > ends_s:
            raise KeyboardInterrupt
        if now_s > shown[0] + 30.0:
            shown[0] = now_s
            print(tally.table(), file=sys.stderr, flush=True)

    with suppress(KeyboardInterrupt):
        campaign(tuple(asked.robots.split(",")), asked.streams, asked.seed, progress, asked.away, asked.skips)
    print(newest[0].table())
    return 1 if newest[0].counts.total() else 0


if __name__ == "__main__":
    sys.exit(main())
