"""A run in virtual time: the same engine, one process, no waiting; repeatable to the bit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from contid.control.engine.cycle import OnEnd, Sink, Timing, VirtualClock
from contid.control.engine.engine import Engine
from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import TicksSkipped
from contid.control.engine.messages import EndOfRows, Message, Rows
from contid.control.engine.ports import BusPort, BusTrackers
from contid.control.engine.report import RunReport, robot_reports
from contid.control.engine.wiring import build_robot_configs, chains_of, clearance_of, open_buses
from contid.robot_file.load import LoadedFile
from contid.targets import Target
from contid.trajectory.timed import Trajectory


class Tee:
    """Several sinks as one."""

    def __init__(self, sinks: Sequence[Sink]) -> None:
        self.sinks = sinks

    def write(self, values: list[float]) -> None:
        """See `contid.control.engine.cycle.Sink`."""
        for sink in self.sinks:
            sink.write(values)

    def event(self, event: RunEvent) -> None:
        """See `contid.control.engine.cycle.Sink`."""
        for sink in self.sinks:
            sink.event(event)


class VirtualProcess:
    """The virtual-time twin of `contid.control.process.control_process`: buses, engine and tick number.

    Attributes:
        buses: by name.
        ports: their owners, by the same names.
        engine: turned by `turn`.
        tick: number of the next tick.
        skipped: ticks skipped so far, because a simulated device answered late.
        cycles: ticks that were run.
        longest_gap_ms: between two ticks that others were left out of [ms of virtual time].
    """

    def __init__(
        self,
        loaded: LoadedFile,
        rate_hz: float,
        sink: Sink,
        *,
        trajectory: Trajectory | None = None,
        on_end: OnEnd = OnEnd.STOP,
        attended: bool = False,
    ) -> None:
        """Open the buses; arguments as in `run_virtual` and `contid.control.engine.engine.Engine`."""
        self.clock = VirtualClock()
        self.buses = open_buses(loaded, self.clock)
        self.ports = {name: BusPort(bus, threaded=False) for name, bus in self.buses.items()}
        self.engine = Engine(
            build_robot_configs(loaded, rate_hz), self.ports, rate_hz, sink, self.clock.now,
            trajectory=trajectory, on_end=on_end, attended=attended,
            chains=chains_of(loaded), clearance=clearance_of(loaded),
        )  # fmt: skip
        self._trackers = BusTrackers(self.buses.values())
        self.tick = self.skipped = self.cycles = 0
        self.longest_gap_ms = 0.0
        self._rate_hz = rate_hz
        self._sink = sink

    def begin(self) -> None:
        """Move to the deadline of the next tick.

        Only a simulated device that answers late gets ahead of it; ticks are skipped then as in real time,
        never caught up.
        """
        late = max(0.0, self.clock.now() - self.tick / self._rate_hz) * self._rate_hz
        if late >= 1.0:
            missed = int(late)
            self.tick, self.skipped = self.tick + missed, self.skipped + missed
            self.longest_gap_ms = max(self.longest_gap_ms, round((missed + 1) / self._rate_hz * 1e3, 3))
            self._sink.event(
                TicksSkipped(ticks=missed, total=self.skipped, longest_gap_ms=self.longest_gap_ms)
            )
        self.clock.set(max(self.tick / self._rate_hz, self.clock.now()))

    def turn(self) -> None:
        """One cycle, after the orders that arrived before it were given to the engine."""
        number, deadline_s = self.tick, self.tick / self._rate_hz
        for measured in self._trackers.arrived(deadline_s):
            self.engine.obey(measured, number)
        self.engine.cycle(Timing(number, self.skipped, deadline_s, self.clock.now() - deadline_s))
        self.tick, self.cycles = number + 1, self.cycles + 1

    def close(self) -> None:
        """Let the buses go."""
        for port in self.ports.values():
            port.close(1.0)


def run_virtual(
    loaded: LoadedFile,
    rate_hz: float,
    trajectory: Trajectory | None,
    *,
    sinks: Sequence[Sink] = (),
    on_end: OnEnd = OnEnd.STOP,
    rows: Iterable[Mapping[str, Target | None]] | None = None,
    orders: Mapping[int, Sequence[Message]] | None = None,
    ticks: int | None = None,
) -> RunReport:
    """Run to the end of the source.

    Args:
        loaded: robot file; its buses must be simulated for time to be virtual.
        rate_hz: of the tick.
        trajectory: what to follow.
        sinks: take records and events.
        on_end: what to do when the source ends; HOLD ends the run too, because no order can come.
        rows: rows of a stream instead of a trajectory; one per tick once every robot is armed.
        orders: messages by the tick before which they arrive.
        ticks: maximum number of ticks.

    Returns:
        The report; a KeyboardInterrupt ends the run early.
    """
    process = VirtualProcess(loaded, rate_hz, Tee(sinks), trajectory=trajectory, on_end=on_end)
    engine = process.engine
    report = RunReport(rate_hz=rate_hz, virtual=True, ending="the input ended")
    queue = iter(rows) if rows is not None else iter(())
    given = 0
    try:
        engine.arm()
        while not engine.finished and (ticks is None or process.tick < ticks):
            process.begin()
            number = process.tick
            for before in range(given, number + 1):
                for message in (orders or {}).get(before, ()):
                    engine.obey(message, number)
            given = number + 1
            if rows is not None and engine.robots.armed and not engine.selector.ended:
                row = next(queue, None)
                engine.obey(EndOfRows() if row is None else Rows(row), number)
            process.turn()
            if engine.selector.ended and on_end is OnEnd.HOLD:
                break
    except KeyboardInterrupt:
        report.ending, report.exit_code = "interrupted", 130
    finally:
        process.close()
    report.ticks, report.skipped = process.cycles, process.skipped
    report.longest_gap_ms = process.longest_gap_ms
    report.robots = robot_reports(engine)
    if report.faulted() and not report.exit_code:
        report.ending, report.exit_code = "a fault stopped a robot", 3
    return report
