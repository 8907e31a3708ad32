"""A run in virtual time: the same engine, one process, no waiting; repeatable to the bit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from contid.control.clock import VirtualClock
from contid.control.cycle import OnEnd, Sink, Timing
from contid.control.engine import Engine
from contid.control.messages import End, Message, Rows
from contid.control.ports import Port
from contid.control.report import Report, robot_reports
from contid.control.wiring import build_plans, open_buses
from contid.description.load import LoadedFile
from contid.targets import Target
from contid.trajectory.timed import Trajectory


class Tee:
    """Several sinks as one; also collects events for whoever runs this."""

    def __init__(self, sinks: Sequence[Sink]) -> None:
        self.sinks = sinks

    def write(self, values: list[float]) -> None:
        """See `contid.control.engine.Sink`."""
        for sink in self.sinks:
            sink.write(values)

    def event(self, kind: str, **fields: Any) -> None:
        """See `contid.control.engine.Sink`."""
        for sink in self.sinks:
            sink.event(kind, **fields)


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
    progress: Callable[[int], None] | None = None,
) -> Report:
    """Run to the end of the source.

    Args:
        loaded: robot file; its buses must be simulated for time to be virtual.
        rate_hz: of the tick.
        trajectory: what to follow.
        sinks: take records and events.
        on_end: what to do when the source ends; HOLD ends the run too, there is nobody to wait for.
        rows: rows of a stream instead of a trajectory; one per tick once every robot is armed.
        orders: messages by the tick before which they arrive.
        ticks: end after so many at the latest.
        progress: called with the number of the tick now and then.

    Returns:
        The report; a KeyboardInterrupt ends the run early and is told in it.
    """
    clock = VirtualClock()
    buses = open_buses(loaded, clock)
    ports = {name: Port(bus, threaded=False) for name, bus in buses.items()}
    sink = Tee(sinks)
    plans = build_plans(loaded, rate_hz)
    engine = Engine(plans, ports, rate_hz, sink, clock.now, trajectory=trajectory, on_end=on_end)
    report = Report(rate_hz=rate_hz, virtual=True, ending="the input ended")
    queue = iter(rows) if rows is not None else iter(())
    number, last, cycles, skipped = 0, -1, 0, 0
    try:
        engine.arm()
        while not engine.finished and (ticks is None or number < ticks):
            # Only a simulated device that answers late gets ahead of the deadline; ticks are skipped as in
            # real time, never caught up.
            late_s = max(0.0, clock.now() - number / rate_hz)
            if late_s * rate_hz >= 1.0:
                missed = int(late_s * rate_hz)
                number, skipped = number + missed, skipped + missed
                sink.event("skipped", ticks=missed, total=skipped)
            deadline_s = number / rate_hz
            clock.set(max(deadline_s, clock.now()))
            for before in range(last + 1, number + 1):
                for message in (orders or {}).get(before, ()):
                    engine.obey(message, number)
            if rows is not None and engine.armed and not engine.ended:
                row = next(queue, None)
                engine.obey(End() if row is None else Rows(row), number)
            engine.cycle(Timing(number, number - last, skipped, deadline_s, clock.now() - deadline_s))
            last, number, cycles = number, number + 1, cycles + 1
            if progress is not None and cycles % 1000 == 0:
                progress(number)
            if engine.ended and on_end is OnEnd.HOLD:
                break
    except KeyboardInterrupt:
        report.ending, report.exit_code = "interrupted", 130
    finally:
        for port in ports.values():
            port.close(1.0)
    report.ticks, report.skipped = cycles, skipped
    report.robots = robot_reports(engine)
    if report.faulted() and not report.exit_code:
        report.ending, report.exit_code = "a fault stopped a robot", 3
    return report
