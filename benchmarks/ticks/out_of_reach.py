"""What rows out of reach cost: processor time of the tick of a robot, before motion rules 7 and now.

``python -m benchmarks.ticks.out_of_reach [ROBOT ...] [--ticks 600] [--times 1.25]``. Rows in a direction of
the plane of x and z (planar robots: x and y), some times as far from the base as the tip at rest, one a tick:
that stand, and that swing by 0.15 rad in 250 ticks. Medians and maxima [us] of the last third of the ticks,
and ticks among them whose target was met. Before: the model is asked in every tick.
"""

from __future__ import annotations

import argparse
import math
import statistics
import time
from collections.abc import Callable
from dataclasses import replace

from contid.control.engine.cycle import OnEnd
from contid.control.engine.engine import Engine
from contid.control.engine.events import RunEvent
from contid.control.engine.messages import Rows
from contid.control.engine.virtual import VirtualProcess
from contid.control.tick.config import MOTION_RULES, RobotConfig
from contid.robot_file.load import load_named, with_mock
from contid.targets import Target, Vec3

ROBOTS = (
    "bend1", "catheter", "cbha", "chain", "chambers3", "finger", "ftdcr_v4", "planar2", "stiffflop1",
    "stiffflop2", "tendon3", "trirack", "trirack2", "trunk",
)  # fmt: skip
Path = Callable[[int], float]


class NoSink:
    """Takes records and events."""

    def write(self, values: list[float]) -> None:
        """See `contid.control.engine.cycle.Sink`."""

    def event(self, event: RunEvent) -> None:
        """See `contid.control.engine.cycle.Sink`."""


def tip_at(config: RobotConfig, angle: float, times: float) -> Vec3:
    """A tip in a direction [m]."""
    away_m = times * math.dist(config.model.forward(config.rest).tip_m, (0.0, 0.0, 0.0))
    across, along = away_m * math.sin(angle), away_m * math.cos(angle)
    return (across, 0.0, along) if config.model.dimension == 3 else (across, along, 0.0)


def tick_us(name: str, before: bool, angle_at: Path, ticks: int, times: float) -> tuple[float, float, int]:
    """Median and greatest time of the tick of the first robot of a file [us], and ticks on target."""
    loaded = with_mock(load_named(name))
    process = VirtualProcess(loaded, loaded.file.rate_hz, NoSink(), on_end=OnEnd.HOLD, attended=True)
    engine: Engine = process.engine
    robots = engine.robots
    rules = 6 if before else MOTION_RULES
    robots.configs = tuple(replace(config, motion_rules=rules) for config in robots.configs)
    config, took_us, met = robots.configs[0], list[float](), list[bool]()
    engine.costs.now = time.thread_time  # what `TickCosts` notes of the robots
    engine.arm()
    for k in range(ticks):
        process.begin()
        if robots.armed:
            tip_m = config.frame.point_in_world(tip_at(config, angle_at(k), times))
            engine.obey(Rows({config.name: Target(tip_m=tip_m)}), process.tick)
        if before:
            robots.states[0] = replace(robots.states[0], missed=None)
        process.turn()
        took_us.append(1e6 * engine.costs.robots_s[0])
        met.append(robots.states[0].missed is None)
    process.close()
    last = took_us[-ticks // 3 :]
    return statistics.median(last), max(last), sum(met[-ticks // 3 :])


def main() -> None:
    """Print a line for each robot."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("robots", nargs="*", default=ROBOTS)
    parser.add_argument("--ticks", type=int, default=600)
    parser.add_argument("--times", type=float, default=1.25)
    asked = parser.parse_args()
    paths: dict[str, Path] = {
        "stand": lambda k: 0.3,
        "move": lambda k: 0.3 + 0.15 * math.sin(math.tau * k / 250),
    }
    print("| robot | stand, before | now | move, before | now |\n|---|---|---|---|---|")
    for name in asked.robots:
        found = [
            "{:.0f}, {:.0f} ({} met)".format(*tick_us(name, before, path, asked.ticks, asked.times))
            for path in paths.values()
            for before in (True, False)
        ]
        print(f"| {name} | {' | '.join(found)} |", flush=True)


if __name__ == "__main__":
    main()
