"""Replay: the recorded inputs through the present code, with every command compared.

    command(n) = engine(robot file, trajectory, orders up to n, samples and answers up to n - 1)

The recording replaces the drivers: in every tick a bus returns its recorded answer, so commands depend on
recorded inputs only, for real and simulated devices, in real and virtual time. Nothing waits; a tick takes as
long as its arithmetic.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from contid.control.engine.cycle import OnEnd, Timing
from contid.control.engine.engine import Engine
from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import BusAnswered, BusStalled, DeviceFaultChanged, UnknownEvent
from contid.control.engine.events.json_form import to_json
from contid.control.engine.events.robots import OrderGiven, RobotOverran
from contid.control.engine.messages import Play
from contid.control.engine.tick_costs import UnansweredError
from contid.control.engine.tick_layout import DEADLINE, LATENESS, SKIPPED, TICK
from contid.control.engine.wiring import build_robot_configs, chains_of, clearance_of
from contid.control.process.isolation.model_ports import models_beside
from contid.control.tick.faults import Fault
from contid.errors import ContidError, SessionError
from contid.robot_file.load import LoadedFile
from contid.session.format.metadata import DURING_RUN
from contid.session.read import Session
from contid.trajectory.timed import Trajectory
from contid_sessions.replay.compare import Comparison, Divergence
from contid_sessions.replay.differences import refuse_other_robots
from contid_sessions.replay.recorded_orders import answer_of, order_of
from contid_sessions.replay.recorded_port import RecordedPort, RecordedTick, records_between, slots_of

#: Events that a replay needs besides the records.
_INPUTS: Final = (OrderGiven, RobotOverran, BusAnswered, BusStalled, DeviceFaultChanged)
_INPUT_KINDS: Final = frozenset(kind.KIND for kind in _INPUTS)

#: Longest time between two recorded ticks that is filled in [s].
LONGEST_GAP_S: Final = 60.0


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
        missing: ticks that the recording lacks.
    """

    ticks: int
    divergence: Divergence | None
    largest: float
    worst: Divergence | None = None
    different: int = 0
    stopped: str = ""
    missing: int = 0


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

    Another number, as by another processor or C library, is counted, and the replay goes on behind it. Ticks
    that the recorder missed run with their events, on the samples between those beside them, and are not
    compared.

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
    # Asked as in the run: what a model answers beside plain numbers passes through the same messages.
    with models_beside(loaded) as own:
        return _replay(session, own, tolerance)


def _replay(session: Session, loaded: LoadedFile, tolerance: float) -> Replayed:
    recorded, sink = RecordedTick(), _Sink()
    ports = {
        bus.name: RecordedPort(bus.name, slots_of(session, [axis for axis, _ in bus.axes]), recorded)
        for bus in loaded.buses.values()
        if bus.axes
    }
    configs = build_robot_configs(loaded, session.rate_hz)
    engine = Engine(
        [replace(config, motion_rules=session.motion_rules) for config in configs],
        ports,  # type: ignore[arg-type]  # a port by behaviour
        session.rate_hz,
        sink,
        lambda: 0.0,
        trajectory=session.trajectory(loaded),
        on_end=OnEnd(session.option("on_end") or "stop"),
        attended=session.option("attended") == "true",
        chains=chains_of(loaded),
        clearance=clearance_of(loaded),
    )
    comparison = Comparison(session.layout, session.device_units, tolerance)
    by_tick: dict[int, list[RunEvent]] = defaultdict(list)
    if session.option("armed") == "false":
        engine.connect()
    else:
        engine.arm()
    first: Divergence | None = None

    def result(stopped: str = "") -> Replayed:
        return Replayed(
            count, first, comparison.largest, comparison.worst, comparison.different, stopped, missing
        )

    last, last_skipped, count, played, missing = -1, 0, 0, 0, 0
    before: Sequence[float] | None = None

    def apply(tick: int) -> None:
        """Apply the events up to a tick that are left; raises `ContidError` for a damaged one."""
        nonlocal played
        due = [each for past in sorted(by_tick) if past <= tick for each in by_tick.pop(past)]
        # A question of an order was not answered: that is known before the order.
        for event in sorted(due, key=lambda each: not isinstance(each, RobotOverran)):
            trajectory = None
            if isinstance(event, OrderGiven) and event.order["order"] == "play":
                played += 1
                trajectory = session.trajectory(loaded, played)
            _apply(event, trajectory, recorded, engine, tick)

    for entry in session.entries():
        if entry.event is not None:
            match entry.event:
                case UnknownEvent(kind=kind, values=fields) if kind in _INPUT_KINDS:
                    tick = fields.get("tick")
                    by_tick[tick if isinstance(tick, int) else last + 1].append(entry.event)
                case OrderGiven() | RobotOverran() | BusAnswered() | BusStalled() | DeviceFaultChanged():
                    by_tick[entry.event.tick].append(entry.event)
            continue
        values = entry.values
        assert values is not None
        tick, skipped = int(values[TICK]), int(values[SKIPPED])
        if tick <= last:
            return result(f"tick {tick} comes after tick {last}: more than one run is in the file")
        lost = tick - last - 1 - (skipped - last_skipped)
        try:
            if lost:
                if lost < 0 or before is None or values[DEADLINE] - before[DEADLINE] > LONGEST_GAP_S:
                    return result(f"ticks {last + 1} to {tick - 1} are not in the recording")
                for between in records_between(before, values, lost):
                    recorded.values, recorded.stalls = between, set()
                    apply(int(between[TICK]))
                    engine.cycle(Timing(int(between[TICK]), last_skipped, between[DEADLINE], 0.0))
                missing += lost
            recorded.values, recorded.stalls = values, set()
            apply(tick)
        except ContidError as error:
            return result(str(error))
        engine.cycle(Timing(tick, skipped, values[DEADLINE], values[LATENESS]))
        divergence = comparison.check(values, sink.values)
        first = first or divergence
        if divergence is not None and not divergence.goes_on:
            return result()
        last, last_skipped, count, before = tick, skipped, count + 1, values
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
                error = UnansweredError(event.message, Fault(event.fault))
                engine.robots.overran[event.robot, event.question] = error
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
