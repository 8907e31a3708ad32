"""A gentle motion for any robot file: what `contid demo` shows until control is taken.

Every axis swings around a place near its rest pose, neighbouring axes a third of a period apart: sections of
arms turn around, tips of fingers go along loops. Every row is the nearest actuation that the model allows.
The motion is checked as any trajectory is, and made smaller until it passes.
"""

from __future__ import annotations

import fcntl
import io
import itertools
import math
import os
import struct
import termios
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Final

from contid.control.engine.wiring import build_preflight, build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.preflight.rows import Unreachable
from contid.errors import ContidError
from contid.robot_file.load import LoadedFile
from contid.targets import Actuation
from contid.trajectory.read import read_trajectory
from contid_panel.samples import inside, values_of
from contid_paths.shapes import minimum_jerk

#: Swing of an axis at first, as a share of its range; how it is made smaller, and how often.
SWING: Final = 0.16
SMALLER: Final = 0.6
TRIES: Final = 5
#: Distance from the ends of an axis, in swings: a curve through rows goes a little beyond them.
MARGIN: Final = 0.1
#: Share of the rates of the robot file that the swing needs, and the least period [s].
GENTLE: Final = 0.25
SHORTEST_S: Final = 8.0
#: How long the swing takes to grow from rest [s]; rows per second of its check, and of the live stream.
GROWTH_S: Final = 4.0
ROWS_PER_S: Final = 5.0
LIVE_ROWS_PER_S: Final = 20.0


def demo_motion(loaded: LoadedFile, rate_hz: float) -> DemoMotion | None:
    """The motion of all robots; None when even the smallest swing is refused."""
    configs = build_robot_configs(loaded, rate_hz)
    preflight = build_preflight(loaded, rate_hz, Unreachable.REFUSE)
    assert preflight is not None, "refusing always checks"
    swing = SWING
    for _ in range(TRIES):
        motion = DemoMotion(loaded, configs, swing)
        text = motion.csv(GROWTH_S + motion.period_s)
        try:
            preflight.trajectory(read_trajectory(io.StringIO(text), "demo", loaded.driven), "demo")
        except ContidError:
            swing *= SMALLER
        else:
            return motion
    return None


class DemoMotion:
    """One swing of all robots of a file.

    Attributes:
        period_s: it repeats after this time.
    """

    def __init__(self, loaded: LoadedFile, configs: Sequence[RobotConfig], swing: float) -> None:
        several = len(loaded.driven) > 1
        self._configs, self._swing = configs, swing
        self._columns: list[str] = []
        for config in configs:
            prefix = f"{config.name}." if several else ""
            self._columns += [f"{prefix}{each}" for each in loaded.driven[config.name].columns]
        self.period_s = max(SHORTEST_S, *(self._slowest_s(config) for config in configs))

    def _slowest_s(self, config: RobotConfig) -> float:
        """The shortest period that stays within a share of all rates."""
        found = 0.0
        for axis, (low, high) in enumerate(zip(config.model.lower, config.model.upper, strict=True)):
            size = self._swing * (high - low)
            for order, rates in enumerate((config.velocity, config.acceleration, config.jerk), start=1):
                found = max(found, 2.0 * math.pi * (size / (GENTLE * rates[axis])) ** (1.0 / order))
        return found

    def csv(self, lasts_s: float) -> str:
        """Its rows from rest on."""
        times = [number / ROWS_PER_S for number in range(math.ceil(lasts_s * ROWS_PER_S) + 1)]
        lines = [",".join(["t_s", *self._columns]), *(f"{t_s:.12g},{self._row(t_s)}" for t_s in times)]
        return "\n".join(lines) + "\n"

    def feed(self, stream: int) -> None:
        """Write rows into a pipe at the pace of time, as a live stream, until its reader ends."""
        with suppress(BrokenPipeError), os.fdopen(stream, "w", encoding="utf-8") as pipe:
            pipe.write(",".join(self._columns) + f"\n{self._row(0.0)}\n")
            pipe.flush()
            while _unread(stream):  # the daemon starts; rows that waited would begin with a jump
                time.sleep(1.0 / LIVE_ROWS_PER_S)
            begun_s = time.monotonic()
            for number in itertools.count():
                time.sleep(max(begun_s + number / LIVE_ROWS_PER_S - time.monotonic(), 0.0))
                # Where it is to be now: rows that were late must not follow each other in a burst.
                pipe.write(self._row(time.monotonic() - begun_s) + "\n")
                pipe.flush()

    def _row(self, t_s: float) -> str:
        row: list[float] = []
        for place, config in enumerate(self._configs):
            row += values_of(config, self._at(config, t_s, place))
        return ",".join(f"{value:.12g}" for value in row)

    def _at(self, config: RobotConfig, t_s: float, place: int) -> Actuation:
        """Axes of a robot at a time, within the limits that couple them."""
        grown = minimum_jerk(min(t_s / GROWTH_S, 1.0))
        own = len(config.axis_names) - config.extra_axes
        values = list(config.rest)
        for axis in range(own):
            low, high = config.model.lower[axis], config.model.upper[axis]
            size = self._swing * (high - low)
            room = (1.0 + MARGIN) * size
            middle = min(max(config.rest[axis], low + room), high - room)
            turn = 2.0 * math.pi * (t_s / self.period_s - axis / 3.0 - place / 2.0 - 0.17 * (axis // 3))
            begin = min(max(config.rest[axis], low + MARGIN * size), high - MARGIN * size)
            values[axis] = begin + grown * (middle + size * math.sin(turn) - begin)
        return inside(config, tuple(values))


def _unread(pipe: int) -> int:
    """Bytes that wait in a pipe."""
    (found,) = struct.unpack("i", fcntl.ioctl(pipe, termios.FIONREAD, bytes(4)))
    return int(found)
