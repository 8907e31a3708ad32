"""The commands of robots compared with the limits of their file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from contid.control.engine.tick_layout import RobotRecord
from contid.control.tick.config import RobotConfig
from contid.control.tick.supervisor import Mode


class Commands:
    """The commands of every tick of some robots.

    Beside another body the jerk is that of robots that follow: a stop in front of a body is the shortest one,
    which begins with a step of the acceleration.
    """

    def __init__(
        self, configs: Sequence[RobotConfig], rate_hz: float, *, beside_a_body: bool = False
    ) -> None:
        self._configs, self._rate_hz, self._beside_a_body = configs, rate_hz, beside_a_body
        self._rows: list[list[float]] = []
        self._judged: list[list[bool]] = []
        self.ticks = 0
        self.exceeded = {"position": 0, "velocity": 0, "acceleration": 0, "jerk": 0}

    def take(self, robots: Sequence[RobotRecord]) -> None:
        """The newest tick, which is the one after that taken before."""
        self._rows.append([axis.command for robot in robots for axis in robot.axes])
        judged = [not self._beside_a_body or robot.mode == Mode.RUN for robot in robots]
        self._judged.append([each for each, robot in zip(judged, robots, strict=True) for _ in robot.axes])
        self.ticks += 1
        if len(self._rows) >= 10_000:
            self.compare()

    def compare(self) -> None:
        """Count what is beyond the limits since the last call; rounding of differences is not."""
        at, judged = np.array(self._rows), np.array(self._judged)
        low, high, speed, change, jerk = (
            np.array([value for config in self._configs for value in of(config)])
            for of in (
                lambda config: [each.lower for each in config.limits],
                lambda config: [each.upper for each in config.limits],
                lambda config: config.velocity,
                lambda config: config.acceleration,
                lambda config: config.jerk,
            )
        )
        size, hz = np.maximum(np.abs(low), np.abs(high)), self._rate_hz
        self.exceeded["position"] += int(((at < low - 1e-9 * size) | (at > high + 1e-9 * size)).sum())
        for order, (name, most) in enumerate(
            (("velocity", speed), ("acceleration", change), ("jerk", jerk)), 1
        ):
            rate = np.abs(np.diff(at, order, axis=0)) * hz**order
            # Of rows that were compared before none is counted twice.
            new = slice(max(0, self._known - order), None)
            wrong = rate > most * (1 + 1e-6) + 4e-16 * 2**order * size * hz**order
            if name == "jerk":
                wrong &= judged[3:] & judged[2:-1] & judged[1:-2] & judged[:-3]
            self.exceeded[name] += int(wrong[new].sum())
        self._rows, self._judged = self._rows[-3:], self._judged[-3:]
        self._known = len(self._rows)

    _known = 0
