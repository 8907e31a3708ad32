"""Replay: the recorded inputs through the present code, with every command compared.

    command(n) = engine(robot file, trajectory, orders up to n, samples and answers up to n - 1)

The recording replaces the drivers: in every tick a bus returns its recorded answer, so commands depend on
recorded inputs only, for real and simulated devices, in real and virtual time. Nothing waits; a tick takes as
long as its arithmetic.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from contid.control.engine.cycle import OnEnd, Timing
from contid.control.engine.engine import Engine
from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import BusAnswered, BusStalled, DeviceFaultChanged, UnknownEvent
from contid.control.engine.events.json_form import to_json
from contid.control.engine.events.robots import OrderGiven, RobotOverran
from contid.control.engine.messages import Play
from contid.control.engine.order_events import answer_of, order_of
from contid.control.engine.ports import BusJob, BusReply
from contid.control.engine.tick_layout import AXIS, DEADLINE, LATENESS, SKIPPED, TICK, AxisRecord
from contid.control.engine.wiring import build_robot_configs, chain_guards, clearance_guard
from contid.errors import ContidError, SessionError
from contid.hal import Sample
from contid.robot_file.load import LoadedFile
from contid.session.compare import Comparison, Divergence
from contid.session.differences import refuse_other_robots
from contid.session.format.metadata import DURING_RUN
from contid.session.read import Session
from contid.trajectory.timed import Trajectory

#: Events that a replay needs besides the records.
_INPUTS: Final = (OrderGiven, RobotOverran, BusAnswered, BusStalled, DeviceFaultChanged)
_INPUT_KINDS: Final = frozenset(kind.KIND for kind in _INPUTS)


@dataclass(frozen=True, slots=True)
class Replayed:
    """The result of a replay.

    Attributes:
        ticks: number of compared ticks.
        divergence: the first one, None if every command was equal.
        largest: largest difference of a command [m or Pa].
        worst: where the largest difference of a command is, None if every command was equal.
        different: number of ticks that differ.
        stopped: why not every recorded tick was compared, "" if all were.
    """

    ticks: int
    divergence: Divergence | None
    largest: float
    worst: Divergence | None = None
    different: int = 0
    stopped: str = ""


@dataclass(frozen=True, slots=True)
class RecordedBus:
    """A recorded bus."""

    name: str
    axes: tuple[str, ...]


class RecordedPort:
    """Replaces `contid.control.engine.ports.BusPort`: returns the answer recorded in the same tick."""

    threaded = False

    def __init__(self, name: str, slots: Mapping[str, int], recorded: RecordedTick) -> None:
        self.bus = RecordedBus(name, tuple(slots))
        self.lost = ""
        self.stalls = 0
        self.retry_at = 0
        self.exempt = False
        self.busy = False
        self._slots = dict(slots)
        self._recorded = recorded

    def lose(self, message: str) -> None:
        """Mark the bus as lost; reopening it must not delay the tick (`BusPort.lose`)."""
        self.lost, self.retry_at = message, 0

    def start(self, job: BusJob) -> None:
        """Begin a job; `take` returns its result.

        See `BusPort.start`; the commands are compared in the record.
        """
        self.busy, self.exempt = True, job.reopen or bool(job.effects)

    def take(self, timeout_s: float) -> BusReply | None:
        """The recorded answer; None in a tick without one."""
        recorded, name = self._recorded, self.bus.name
        answer = recorded.answers.pop(name, None)
        if answer is None:
            if self.lost or name in recorded.stalls:
                self.stalls += 1
                return None
            answer = BusReply()
        self.busy, self.stalls = False, 0
        if not answer.lost:
            answer.samples = self._samples()
        return answer

    def close(self, timeout_s: float) -> None:
        """Close the bus; a worker that hangs in its device is abandoned (a daemon thread)."""

    def _samples(self) -> dict[str, Sample]:
        values, faults = self._recorded.values, self._recorded.faults
        out = {}
        for axis, at in self._slots.items():
            read = AxisRecord(*values[at : at + AXIS.size])
            out[axis] = Sample(
                _number(read.value), read.time_s, bool(read.valid), read.age_s, _number(read.velocity),
                _number(read.effort), _number(read.temperature_c), _number(read.voltage_v),
                faults.get(axis, ""),
            )  # fmt: skip
        return out


def _number(value: float) -> float | None:
    return None if value != value else value


@dataclass(slots=True)
class RecordedTick:
    """Recorded values and events of the present tick."""

    values: Sequence[float] = ()
    answers: dict[str, BusReply] = field(default_factory=dict)
    stalls: set[str] = field(default_factory=set)
    faults: dict[str, str] = field(default_factory=dict)


class _Sink:
    """Keeps the record of a replayed tick."""

    def __init__(self) -> None:
        self.values: list[float] = []

    def write(self, values: list[float]) -> None:
        self.values = values

    def event(self, event: RunEvent) -> None:
        """Ignored: the recording has the events."""


def replay(session: Session, loaded: LoadedFile, tolerance: float = 0.0) -> Replayed:
    """Run a session again, up to its end or to another state, fault or limit of a robot.

    Another number, as by another processor or C library, is counted, and the replay goes on behind it.

    Args:
        session: the recording.
        loaded: robot file; the recorded one, or another with the same robots and axes.
        tolerance: allowed difference of a command [mm or bar]; 0 compares bit for bit.

    Raises:
        ContidError: the robot file has other robots or axes, or the trajectory does not fit it.
    """
    if session.option(DURING_RUN) == "true":
        message = "begins during a run: a replay needs the first tick, as `contid run --record` has it"
        raise SessionError(f"{session.path}: {message}")
    refuse_other_robots(session, loaded)
    recorded, sink = RecordedTick(), _Sink()
    ports = {
        bus.name: RecordedPort(bus.name, _slots(session, [axis for axis, _ in bus.axes]), recorded)
        for bus in loaded.buses.values()
        if bus.axes
    }
    engine = Engine(
        build_robot_configs(loaded, session.rate_hz),
        ports,  # type: ignore[arg-type]  # a port by behaviour
        session.rate_hz,
        sink,
        lambda: 0.0,
        trajectory=session.trajectory(loaded),
        on_end=OnEnd(session.option("on_end") or "stop"),
        attended=session.option("attended") == "true",
        guards=chain_guards(loaded),
        clearance=clearance_guard(loaded),
    )
    comparison = Comparison(session.layout, session.device_units, tolerance)
    by_tick: dict[int, list[RunEvent]] = defaultdict(list)
    if session.option("armed") == "false":
        engine.connect()
    else:
        engine.arm()
    first: Divergence | None = None

    def result(stopped: str = "") -> Replayed:
        return Replayed(count, first, comparison.largest, comparison.worst, comparison.different, stopped)

    last, last_skipped, count, played = -1, 0, 0, 0
    for entry in session.entries():
        if entry.event is not None:
            match entry.event:
                case UnknownEvent(kind=kind, values=fields) if kind in _INPUT_KINDS:
                    by_tick[fields.get("tick", last + 1)].append(entry.event)
                case OrderGiven() | RobotOverran() | BusAnswered() | BusStalled() | DeviceFaultChanged():
                    by_tick[entry.event.tick].append(entry.event)
            continue
        values = entry.values
        assert values is not None
        tick, skipped = int(values[TICK]), int(values[SKIPPED])
        if tick - last != 1 + skipped - last_skipped:
            message = f"ticks {last + 1} to {tick - 1} are not in the recording"
            if tick <= last:
                message = f"tick {tick} comes after tick {last}: more than one run is in the file"
            return result(message)
        recorded.values, recorded.stalls = values, set()
        for event in by_tick.pop(tick, ()):
            try:
                trajectory = None
                if isinstance(event, OrderGiven) and event.order["order"] == "play":
                    played += 1
                    trajectory = session.trajectory(loaded, played)
                _apply(event, trajectory, recorded, engine, tick)
            except ContidError as error:
                return result(str(error))
        engine.cycle(Timing(tick, skipped, values[DEADLINE], values[LATENESS]))
        divergence = comparison.check(values, sink.values)
        first = first or divergence
        if divergence is not None and not divergence.goes_on:
            return result()
        last, last_skipped, count = tick, skipped, count + 1
    return result()


def _apply(
    event: RunEvent, trajectory: Trajectory | None, recorded: RecordedTick, engine: Engine, tick: int
) -> None:
    """Apply an event to the present tick; ``trajectory`` is that of an order ``play``.

    Raises:
        ContidError: the event is damaged.
    """
    try:
        match event:
            case OrderGiven():
                waits = bool(event.order.get("waits", False))
                engine.obey(order_of(event) if trajectory is None else Play(trajectory, waits), tick)
            case RobotOverran():
                engine.overran[event.robot] = event.message
            case BusAnswered():
                recorded.answers[event.bus] = answer_of(event)
            case BusStalled():
                recorded.stalls.add(event.bus)
            case DeviceFaultChanged():
                recorded.faults[event.axis] = event.fault
            case UnknownEvent():
                raise ValueError("keys or types are wrong")
    except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        kind = to_json(event)["event"]
        message = f"its event {kind!r} is damaged: {type(error).__name__}: {error}"
        raise ContidError(f"tick {tick}: {message}") from error


def _slots(session: Session, axes: Sequence[str]) -> dict[str, int]:
    """Index of the first value of every axis of a bus in a record."""
    slots = {
        f"{robot.name}.{axis}": session.layout.axis_start(index, number)
        for index, robot in enumerate(session.layout.robots)
        for number, axis in enumerate(robot.axes)
    }
    return {axis: slots[axis] for axis in axes if axis in slots}
