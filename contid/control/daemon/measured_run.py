"""A simulated run in virtual time whose ticks are measured: what they take of the processor's time."""

from __future__ import annotations

import gc
import io
import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import Any, Final, NamedTuple
from zlib import crc32

from contid.control.engine.cycle import OnEnd, Sink
from contid.control.engine.events import RunEvent
from contid.control.engine.messages import Begin, Hold, Play, Resume, Rows
from contid.control.engine.virtual import VirtualProcess
from contid.control.engine.wiring import record_layout
from contid.control.tick.config import RobotConfig
from contid.control.tick.supervisor import Mode
from contid.hal import load_driver
from contid.robot_file.load import LoadedFile, with_mock
from contid.targets import Actuation, Target, Vec3
from contid.trajectory.columns import column_groups
from contid.trajectory.read import read_trajectory
from contid.units import MM_PER_M

#: What robots may do while they are measured: stand, follow a timed trajectory, follow a live stream.
MOTIONS: Final = ("hold", "path", "stream")
#: Rows per second, the period of the motion [s], and its greatest speed as a share of the limits of the axes.
ROWS_HZ: Final = 50.0
MOTION_S: Final = 2.0
SPEED: Final = 0.2
#: Largest part of its way towards the end of its range that an axis goes.
_REACH: Final = 0.1
#: Fewest ticks of a figure, and virtual time until the robots are armed or have come to the motion [s].
LEAST_TICKS: Final = 20
ARMING_S: Final = 20.0


class TickTimes(NamedTuple):
    """Time of a whole tick, of each robot, and of each bus with its simulated devices [s]."""

    whole_s: float
    robots_s: tuple[float, ...]
    buses_s: tuple[float, ...]


class _PackedRecords:
    """A sink that packs records as the ring does, and drops them or gives them to another sink."""

    def __init__(self, loaded: LoadedFile, rate_hz: float) -> None:
        self._packer = record_layout(loaded, rate_hz).packer()
        self.copies_to: Sink | None = None

    def write(self, values: list[float]) -> None:
        crc32(self._packer.pack(*values))
        if self.copies_to is not None:
            self.copies_to.write(values)

    def event(self, event: RunEvent) -> None:
        pass


@contextmanager
def measured_run(loaded: LoadedFile, rate_hz: float, longest_s: float) -> Iterator[MeasuredRun]:
    """A run of a file at a rate, on simulated buses without journals or faults, and without gc.

    Arming takes ``longest_s`` at most, and so does each motion.
    """
    options, mock = load_driver("sim").bus_options(), with_mock(loaded)
    plain = replace(mock, buses={name: replace(bus, options=options) for name, bus in mock.buses.items()})
    collects = gc.isenabled()
    gc.disable()
    try:
        measured = MeasuredRun(plain, rate_hz, longest_s)
        with closing(measured.process):
            yield measured
    finally:
        if collects:
            gc.enable()


class MeasuredRun:
    """The run with its stopwatches; ``robots`` and ``buses`` are names, in the order of `TickTimes`."""

    def __init__(self, loaded: LoadedFile, rate_hz: float, longest_s: float) -> None:
        self._loaded, self._rate_hz, self._longest_s = loaded, rate_hz, longest_s
        self.sink = _PackedRecords(loaded, rate_hz)
        self.process = VirtualProcess(loaded, rate_hz, self.sink, on_end=OnEnd.HOLD, attended=True)
        self._engine = engine = self.process.engine
        engine.costs.now = time.thread_time
        self.robots = tuple(config.name for config in engine.robots.configs)
        self.buses = tuple(self.process.buses)
        self._buses_s = dict.fromkeys(self.buses, 0.0)
        for name, bus in self.process.buses.items():
            bus.exchange = self._timed(name, bus.exchange)  # type: ignore[method-assign]  # a stopwatch
        engine.arm()
        self._turn_until(lambda: engine.robots.armed)
        robots = zip(engine.robots.configs, engine.robots.states, strict=True)
        self._tips = {
            config.name: _slow_tip(config, state.command) for config, state in robots if state.command
        }

    def ticks(self, motion: str, virtual_s: float) -> list[TickTimes]:
        """The times of the ticks of one of `MOTIONS`, for a virtual time, but at least `LEAST_TICKS`."""
        match motion:
            case "path":
                self._begin_path(virtual_s)
            case "stream":
                self._begin_stream()
        first, row = self.process.tick, 0
        last = first + max(virtual_s * self._rate_hz, LEAST_TICKS)
        ends_s = time.monotonic() + self._longest_s
        found: list[TickTimes] = []
        while self.process.tick < last and (time.monotonic() < ends_s or len(found) < 2):
            arrives = motion == "stream" and (self.process.tick - first) / self._rate_hz * ROWS_HZ >= row
            rows, row = self._row(row) if arrives else None, row + arrives
            begin_s = time.thread_time()
            if rows is not None:
                self._obey(rows)
            self._turn()
            whole_s = time.thread_time() - begin_s
            found.append(
                TickTimes(whole_s, tuple(self._engine.costs.robots_s), tuple(self._buses_s.values()))
            )
        return found

    def _begin_path(self, virtual_s: float) -> None:
        """Let the robots come to the first row of a timed trajectory."""
        header, columns = ["t_s"], []
        times_s = [k / ROWS_HZ for k in range(int(virtual_s * ROWS_HZ) + 2)]
        alone = len(self._loaded.file.robots) == 1
        for name, tip_at in self._tips.items():
            names = column_groups("" if alone else f"{name}.", self._loaded.file.robots[name])["tip"]
            header += names
            tips = [tip_at(time_s) for time_s in times_s]
            columns += [[MM_PER_M * tip[k] for tip in tips] for k in range(len(names))]
        rows = [",".join(map(repr, row)) for row in zip(times_s, *columns, strict=True)]
        text = io.StringIO("\n".join([",".join(header), *rows]) + "\n")
        self._obey(Play(read_trajectory(text, "budget", self._loaded.driven)))
        self._turn_until(self._follow)

    def _begin_stream(self) -> None:
        """Let the robots come to the first row of a live stream."""
        self._obey(Hold())
        self._turn()
        self._obey(Begin())
        self._obey(Resume())
        self._obey(self._row(0))
        self._turn()
        self._turn_until(self._follow)

    def _follow(self) -> bool:
        return all(state.mode in (Mode.RUN, Mode.FAULT) for state in self._engine.robots.states)

    def _row(self, row: int) -> Rows:
        return Rows({name: Target(tip_m=tip_at(row / ROWS_HZ)) for name, tip_at in self._tips.items()})

    def _obey(self, order: Play | Hold | Begin | Resume | Rows) -> None:
        self._engine.obey(order, self.process.tick)

    def _turn(self) -> None:
        self.process.begin()
        self.process.turn()

    def _turn_until(self, over: Callable[[], bool]) -> None:
        ends_s, last = time.monotonic() + self._longest_s, self.process.tick + ARMING_S * self._rate_hz
        while not over() and self.process.tick < last and time.monotonic() < ends_s:
            self._turn()

    def _timed(self, name: str, exchange: Callable[..., Any]) -> Callable[..., Any]:
        def timed(commands: Mapping[str, float]) -> Any:
            begin_s = time.thread_time()
            try:
                return exchange(commands)
            finally:
                self._buses_s[name] = time.thread_time() - begin_s

        return timed


def _slow_tip(config: RobotConfig, command: Actuation) -> Callable[[float], Vec3]:
    """The tip by time [s] on a slow motion of the axes from where they stand and back; world frame [m].

    It begins inside the limits: a device may measure its end as a step of its encoder beyond them, and the
    model searches long for a tip that is out of reach by so little. Each axis goes a share of its way to the
    middle between the middle of its range and one end of it, the upper one of every second axis: share
    (1 - cos(2 pi t / `MOTION_S`)) / 2, at most at `SPEED` of its limit.
    """
    lower, upper = config.model.lower, config.model.upper
    own = zip(lower, upper, command, strict=False)
    begin = [min(max(at, low), high) for low, high, at in own]
    ways = [
        0.25 * (low + high) + 0.5 * (low, high)[k % 2] - at
        for k, (low, high, at) in enumerate(zip(lower, upper, begin, strict=True))
    ]
    bounds = [
        SPEED * limit * MOTION_S / (math.pi * abs(way))
        for limit, way in zip(config.velocity, ways, strict=False)
        if way
    ]
    share = min([_REACH, *bounds])

    def tip_at(time_s: float) -> Vec3:
        part = share * 0.5 * (1.0 - math.cos(2.0 * math.pi * time_s / MOTION_S))
        axes = tuple(at + part * way for at, way in zip(begin, ways, strict=True))
        return config.frame.point_in_world(config.model.forward(axes).tip_m)

    return tip_at
