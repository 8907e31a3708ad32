"""Measures what the ticks of a robot file cost on this machine, on simulated devices and in virtual time.

A stopwatch counts the time of the processor. The slower half of the ticks is left out: a busy machine, whose
processors share caches and pipelines, makes ticks take two or three times as long.
"""

from __future__ import annotations

import gc
import io
import logging
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import Any, Final, NamedTuple
from zlib import crc32

from contid.control.daemon.budget import Budget, TickCost
from contid.control.engine.cycle import OnEnd, Sink
from contid.control.engine.events import RunEvent
from contid.control.engine.messages import Begin, Hold, Play, Resume, Rows
from contid.control.engine.virtual import VirtualProcess
from contid.control.engine.wiring import record_layout
from contid.control.tick.config import RobotConfig
from contid.control.tick.supervisor import Mode
from contid.errors import ContidError
from contid.hal import load_driver
from contid.robot_file.document import Isolation
from contid.robot_file.load import LoadedFile, with_mock
from contid.robot_file.loader import robot_classes
from contid.robot_file.tick_rate import exchange_time
from contid.targets import Actuation, Target, Vec3
from contid.trajectory.columns import column_groups
from contid.trajectory.read import read_trajectory

#: Rows per second, the period of the motion [s], and its greatest speed as a share of the limits of the axes.
ROWS_HZ: Final = 50.0
MOTION_S: Final = 2.0
SPEED: Final = 0.2
#: What robots may do while they are measured.
MOTIONS: Final = ("hold", "path", "stream")
#: Robot time of the looks before a run, and the longest time of arming and of measuring in each [s].
LOOKS_S: Final = (0.1, 0.3)
LOOK_S: Final = 0.5
#: Fewest ticks of a figure, and virtual time until the robots are armed and have come to the motion [s].
LEAST_TICKS: Final = 20
ARMING_S: Final = 20.0

log = logging.getLogger(__name__)


class _Counting:
    """A sink that packs records as the ring does, and drops them, or gives them to another sink."""

    def __init__(self, loaded: LoadedFile, rate_hz: float) -> None:
        self._packer = record_layout(loaded, rate_hz).packer()
        self.records: Sink | None = None

    def write(self, values: list[float]) -> None:
        crc32(self._packer.pack(*values))
        if self.records is not None:
            self.records.write(values)

    def event(self, event: RunEvent) -> None:
        pass


class _TickTimes(NamedTuple):
    """Time of a whole tick, and of its robots and buses [s]."""

    whole_s: float
    robots_s: tuple[float, ...]
    buses_s: tuple[float, ...]


class _Measured:
    """A simulated run with stopwatches."""

    def __init__(self, loaded: LoadedFile, rate_hz: float, longest_s: float) -> None:
        self._loaded, self._rate_hz, self._longest_s = loaded, rate_hz, longest_s
        self.sink = _Counting(loaded, rate_hz)
        self.process = VirtualProcess(loaded, rate_hz, self.sink, on_end=OnEnd.HOLD, attended=True)
        self._engine = self.process.engine
        self._engine.costs.now = time.thread_time
        self._buses_s = dict.fromkeys(self.process.buses, 0.0)
        for name, bus in self.process.buses.items():
            bus.exchange = self._timed(name, bus.exchange)  # type: ignore[method-assign]  # a stopwatch
        self._engine.arm()
        self._until(lambda: self._engine.robots.armed)
        robots = zip(self._engine.robots.configs, self._engine.robots.states, strict=True)
        self._tips = {config.name: _tips(config, state.command) for config, state in robots if state.command}

    def _timed(self, name: str, exchange: Callable[..., Any]) -> Callable[..., Any]:
        def timed(commands: Mapping[str, float]) -> Any:
            begin_s = time.thread_time()
            try:
                return exchange(commands)
            finally:
                self._buses_s[name] = time.thread_time() - begin_s

        return timed

    def _turn(self, row: int | None = None) -> None:
        if row is not None:
            time_s = row / ROWS_HZ
            targets = {name: Target(tip_m=tip(time_s)) for name, tip in self._tips.items()}
            self._engine.obey(Rows(targets), self.process.tick)
        self.process.begin()
        self.process.turn()

    def _until(self, over: Callable[[], bool]) -> None:
        ends_s, last = time.monotonic() + self._longest_s, self.process.tick + ARMING_S * self._rate_hz
        while not over() and self.process.tick < last and time.monotonic() < ends_s:
            self._turn()

    def _ticks(self, rows: bool, virtual_s: float) -> list[_TickTimes]:
        """Turn and count."""
        ends_s, began = time.monotonic() + self._longest_s, self.process.tick
        last, row = began + max(virtual_s * self._rate_hz, LEAST_TICKS), 0
        found: list[_TickTimes] = []
        while self.process.tick < last and (time.monotonic() < ends_s or len(found) < 2):
            begin_s, due = time.thread_time(), (self.process.tick - began) / self._rate_hz * ROWS_HZ
            self._turn(row if rows and due >= row else None)
            row += rows and due >= row
            robots_s = tuple(self._engine.costs.robots_s)
            found.append(_TickTimes(time.thread_time() - begin_s, robots_s, tuple(self._buses_s.values())))
        return found

    def cost(self, motion: str, virtual_s: float) -> TickCost:
        """Of a motion; the slower half of the ticks is left out, as what the machine does besides."""
        found = self.ticks(motion, virtual_s)
        kept = sorted(found)[: (len(found) + 1) // 2]
        count = len(kept)
        names = [config.name for config in self._engine.robots.configs]
        robots = {name: sum(each.robots_s[k] for each in kept) / count for k, name in enumerate(names)}
        buses = {name: sum(each.buses_s[k] for each in kept) / count for k, name in enumerate(self._buses_s)}
        rest_s = sum(each.whole_s for each in kept) / count - sum(robots.values()) - sum(buses.values())
        return TickCost(motion, robots, buses, max(rest_s, 0.0))

    def ticks(self, motion: str, virtual_s: float) -> list[_TickTimes]:
        """Of one of `MOTIONS`."""
        times: list[_TickTimes] = getattr(self, motion)(virtual_s)
        return times

    def hold(self, virtual_s: float) -> list[_TickTimes]:
        """Robots that stand."""
        return self._ticks(False, virtual_s)

    def path(self, virtual_s: float) -> list[_TickTimes]:
        """Robots that follow a timed trajectory."""
        header, columns = ["t_s"], []
        times_s = [k / ROWS_HZ for k in range(int(virtual_s * ROWS_HZ) + 2)]
        alone = len(self._loaded.file.robots) == 1
        for name, tip in self._tips.items():
            groups = column_groups("" if alone else f"{name}.", self._loaded.file.robots[name])
            header += groups["tip"]
            tips = [tip(time_s) for time_s in times_s]
            columns += [[1e3 * each[k] for each in tips] for k in range(len(groups["tip"]))]
        rows = [",".join(map(repr, row)) for row in zip(times_s, *columns, strict=True)]
        text = io.StringIO("\n".join([",".join(header), *rows]) + "\n")
        self._engine.obey(Play(read_trajectory(text, "budget", self._loaded.driven)), self.process.tick)
        self._until(self._runs)
        return self._ticks(False, virtual_s)

    def stream(self, virtual_s: float) -> list[_TickTimes]:
        """Robots that follow a live stream."""
        self._engine.obey(Hold(), self.process.tick)
        self._turn()
        self._engine.obey(Begin(), self.process.tick)
        self._engine.obey(Resume(), self.process.tick)
        self._turn(0)
        self._until(self._runs)
        return self._ticks(True, virtual_s)

    def _runs(self) -> bool:
        return all(state.mode in (Mode.RUN, Mode.FAULT) for state in self._engine.robots.states)


def _tips(config: RobotConfig, command: Actuation) -> Callable[[float], Vec3]:
    """The tip on a slow motion of the axes from where they stand and back, by time [s]; world frame [m]."""
    model = config.model
    ends = [(low, high)[k % 2] for k, (low, high) in enumerate(zip(model.lower, model.upper, strict=True))]
    ways = [
        0.25 * (low + high) + 0.5 * end - at
        for low, high, end, at in zip(model.lower, model.upper, ends, command, strict=False)
    ]
    bounds = [
        SPEED * v * MOTION_S / (math.pi * abs(way))
        for v, way in zip(config.velocity, ways, strict=False)
        if way
    ]
    share = min([0.1, *bounds])

    def tip(time_s: float) -> Vec3:
        part = share * 0.5 * (1.0 - math.cos(2.0 * math.pi * time_s / MOTION_S))
        axes = tuple(at + part * way for at, way in zip(command, ways, strict=False))
        return config.frame.point_in_world(model.forward(axes).tip_m)

    return tip


def measure_budget(
    loaded: LoadedFile,
    rate_hz: float,
    virtual_s: float,
    longest_s: float,
    motions: Sequence[str] = MOTIONS,
    records: Sink | None = None,
) -> Budget:
    """Measure what a tick of a file costs on this machine.

    Args:
        loaded: the robot file; its devices are simulated.
        rate_hz: of the tick.
        virtual_s: robot time of each kind of motion.
        longest_s: time of each, in all.
        motions: of `MOTIONS`, in this order.
        records: gets the ticks of as much of the last motion again, which is not measured.

    Raises:
        ContidError: the simulated robots cannot be built.
    """
    own = frozenset(
        name
        for name, bus in loaded.buses.items()
        if bus.driver == "sim" and bus.isolation is not Isolation.PROCESS
    )
    wires = {name: exchange_time(bus) for name, bus in loaded.buses.items()}
    wires_s = {name: wire.least_s for name, wire in wires.items() if wire is not None}
    with _measured(loaded, rate_hz, longest_s) as measured:
        costs = tuple(measured.cost(motion, virtual_s) for motion in motions)
        if records is not None:
            measured.sink.records = records
            measured.ticks(motions[-1], virtual_s)
    return Budget(rate_hz, wires_s, own, costs)


def robot_times(loaded: LoadedFile, virtual_s: float, motion: str, longest_s: float) -> list[float]:
    """Time of the processor that the robots of a file take in each tick of a motion, from its first on [s].

    Args:
        loaded: the robot file; its devices are simulated, at its own rate.
        virtual_s: robot time of the motion.
        motion: of `MOTIONS`.
        longest_s: time of measuring.
    """
    with _measured(loaded, loaded.file.rate_hz, longest_s) as measured:
        return [sum(each.robots_s) for each in measured.ticks(motion, virtual_s)]


@contextmanager
def _measured(loaded: LoadedFile, rate_hz: float, longest_s: float) -> Iterator[_Measured]:
    """A simulated run, without collections of garbage."""
    collects = gc.isenabled()
    gc.disable()
    try:
        measured = _Measured(_plain(loaded), rate_hz, longest_s)
        with closing(measured.process):
            yield measured
    finally:
        if collects:
            gc.enable()


def _plain(loaded: LoadedFile) -> LoadedFile:
    """The file on simulated buses that write no journal and have no faults."""
    plain = load_driver("sim").bus_options()
    mock = with_mock(loaded)
    return replace(mock, buses={name: replace(bus, options=plain) for name, bus in mock.buses.items()})


def check_budget(loaded: LoadedFile, rate_hz: float, motion: str) -> None:
    """Refuse a run whose ticks do not fit, before anything is opened.

    The first look is short; only where it finds that they may not fit there is a second. Models of other
    distributions are not called here: what they do ends in the control process.

    Args:
        loaded: the robot file.
        rate_hz: of the tick.
        motion: of `MOTIONS`, what the robots are to do.

    Raises:
        ContidError: they do not fit.
    """
    if not all(isinstance(robot, tuple(robot_classes().values())) for robot in loaded.driven.values()):
        return
    try:
        for virtual_s in LOOKS_S:
            budget = measure_budget(loaded, rate_hz, virtual_s, LOOK_S, (motion,))
            if not budget.refusal():
                return
            if budget.highest_rate_hz < 0.5 * rate_hz:
                break
    except Exception as error:  # what the robots do with it is theirs to find
        log.warning("the time of a tick was not measured: %s: %s", type(error).__name__, error)
        return
    raise ContidError(f"{loaded.path}: {budget.refusal()}")
