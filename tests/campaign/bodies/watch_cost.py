"""What the watch of the bodies costs: processor time of a tick with and without it, in turns in one process.

``python -m tests.campaign.bodies.watch_cost [--ticks N] [--robot NAME ...]``. Both engines follow the same
slow motion of the axes in virtual time; the exchange with the simulated buses does not count. Medians.
"""

from __future__ import annotations

import argparse
import math
import statistics
import time
from collections.abc import Iterator, Mapping
from typing import Final

from contid.control.engine.cycle import Timing
from contid.control.engine.messages import Rows
from contid.control.engine.virtual import Tee, VirtualProcess
from contid.control.engine.watch.body_watch import BodyWatch
from contid.control.engine.watch.path_pace import PathPace
from contid.robot_file.load import find_robot_file, load_robot_file, with_mock
from contid.targets import Target

ROBOTS: Final = ("finger", "hand", "stiffflop2", "tendon3", "trirack2")
RATE_HZ: Final = 200.0


class TimedTurns:
    """Turns of one engine; the time of the exchange is left out.

    Attributes:
        spent_us: of every turn.
    """

    def __init__(self, name: str, watched: bool) -> None:
        self.spent_us: list[float] = []
        self._process = VirtualProcess(with_mock(load_robot_file(find_robot_file(name))), RATE_HZ, Tee([]))
        engine = self._engine = self._process.engine
        if not watched:
            for method in ("_before", "_after", "_settle"):
                stages = getattr(engine, method)
                left = tuple(each for each in stages if not isinstance(each, BodyWatch | PathPace))
                setattr(engine, method, left)
        self._apart_ns = 0
        exchange, run = engine.exchange, engine.exchange.run

        def timed(commands: Mapping[str, Mapping[str, float]], timing: Timing, now_s: float) -> None:
            began_ns = time.thread_time_ns()
            run(commands, timing, now_s)
            self._apart_ns += time.thread_time_ns() - began_ns

        exchange.run = timed  # type: ignore[method-assign]
        engine.arm()

    def turn(self, row: dict[str, Target | None]) -> None:
        """One turn."""
        process = self._process
        process.begin()
        self._engine.obey(Rows(row), process.tick)
        self._apart_ns = 0
        began_ns = time.thread_time_ns()
        process.turn()
        self.spent_us.append((time.thread_time_ns() - began_ns - self._apart_ns) / 1e3)

    def rows(self) -> Iterator[dict[str, Target | None]]:
        """About the rest pose, by a hundredth of the travel in 4 s."""
        tick = 0
        while True:
            share = 0.01 * math.sin(2.0 * math.pi * tick / (4.0 * RATE_HZ))
            yield {
                config.name: Target(
                    actuation=tuple(
                        min(max(rest + share * (limit.upper - limit.lower), limit.lower), limit.upper)
                        for rest, limit in zip(config.rest, config.limits, strict=True)
                    )
                )
                for config in self._engine.robots.configs
            }
            tick += 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=3000)
    parser.add_argument("--robot", nargs="*", default=ROBOTS)
    asked = parser.parse_args()
    for name in asked.robot:
        plain, watched = TimedTurns(name, False), TimedTurns(name, True)
        rows = plain.rows()
        for _ in range(asked.ticks):
            row = next(rows)
            for each in (plain, watched):
                each.turn(row)
        without, with_it = (statistics.median(each.spent_us[400:]) for each in (plain, watched))
        print(f"{name}: {without:.1f} us without, {with_it:.1f} with ({with_it / without - 1.0:+.1%})")


if __name__ == "__main__":
    main()
