"""One cycle of the whole robot file: targets, the tick of every robot, the exchange with every bus, a record.

The control process calls `Engine.cycle` at every deadline, virtual mode in a plain loop; the constructor gets
what differs between them: clock, ports and sink.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from contid.control.engine.cycle import OnEnd, Sink, Timing
from contid.control.engine.events.robots import OrderRefused
from contid.control.engine.exchange import Exchange
from contid.control.engine.order_handler import NumberedRefusals, OrderHandler
from contid.control.engine.outcomes import Outcomes
from contid.control.engine.pack_record import RecordPacker
from contid.control.engine.ports import BusPort
from contid.control.engine.robots import Order, Robots
from contid.control.engine.sources import Live, Timed
from contid.control.engine.stages import (
    ArmsTogether,
    BodyClearance,
    ChainGuards,
    EngineParts,
    ReactsToContacts,
    TickStage,
    stages_of_extras,
    with_method,
)
from contid.control.engine.stall_watch import StallWatch
from contid.control.engine.target_selector import TargetSelector
from contid.control.engine.tick_costs import TickCosts, UnansweredError
from contid.control.engine.watch.arrivals import Arrivals
from contid.control.engine.watch.body_watch import BodyWatch
from contid.control.engine.watch.path_pace import PathPace
from contid.control.engine.watch.tip_watch import TipWatch
from contid.control.tick import transitions
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault
from contid.control.tick.robot_tick import TickResult, stop_without_model, tick, tick_again
from contid.control.tick.supervisor import Mode
from contid.entry_points import CONTACTS, required
from contid.targets import Target
from contid.trajectory.timed import Trajectory


class Engine:
    """The robots, their buses and their source of targets.

    Attributes:
        robots: with their configurations, states and statistics.
        exchange: with the buses.
        selector: of the source of targets.
        body_watch: compares what the axes measure with their commands.
        finished: every robot rests after the end of the source, or after an order to finish.
        costs: where the time of the newest cycle went.
    """

    def __init__(
        self,
        configs: Sequence[RobotConfig],
        ports: Mapping[str, BusPort],
        rate_hz: float,
        sink: Sink,
        now: Callable[[], float],
        *,
        trajectory: Trajectory | None = None,
        on_end: OnEnd = OnEnd.STOP,
        attended: bool = False,
        chains: ChainGuards | None = None,
        clearance: BodyClearance | None = None,
    ) -> None:
        """Prepare; accesses no device.

        Args:
            configs: of the robots, in file order.
            ports: by bus name; already open.
            rate_hz: of the tick.
            sink: takes records and events.
            now: the clock of the buses, as a function.
            trajectory: what to follow, None to wait for rows or orders.
            on_end: reaction to the end of the source.
            attended: a client may give orders: the run does not end because every robot is in FAULT.
            chains: the closed chains among the robots, None without.
            clearance: what keeps bodies apart, None without.
        """
        self.finished = False
        records = sink
        self._sink = sink = self._refusals = NumberedRefusals(sink)
        self.costs = TickCosts(now, len(configs), tuple(ports))
        self.robots = Robots(configs, sink, self.costs)
        self.exchange = Exchange(self.robots, ports, rate_hz, sink, self.costs)
        together = ArmsTogether()
        if chains is not None:
            together = chains.monitor(self.robots, self.exchange, sink)
        self.selector = TargetSelector(
            self.robots, together, rate_hz, sink, trajectory=trajectory, on_end=on_end, attended=attended
        )
        contacts: ReactsToContacts | None = None
        if any(config.contact is not None for config in configs):
            build = required(CONTACTS, "stage", "the key `sense.contact` of a robot", "contact")
            contacts = build(self.robots, self.exchange, together, sink)
        react, selector = None if contacts is None else contacts.react, self.selector
        parts = EngineParts(
            self.robots, self.exchange, react, sink, lambda: isinstance(selector.source, Timed)
        )
        stages: list[TickStage] = []
        if clearance is not None:
            stages.append(clearance.stage(parts))
        if together.has_chains:
            stages.append(together)
        if contacts is not None:
            stages.append(contacts)
        self.body_watch = BodyWatch(self.robots, self.exchange)
        stages += [*stages_of_extras(parts), StallWatch(self.robots, rate_hz), self.body_watch]
        if all(config.motion_rules > 2 for config in configs):
            stages.append(PathPace(self.robots, self.body_watch, self.selector, sink))
        if any(config.follow_tip_m is not None for config in configs):
            stages.append(TipWatch(self.robots, self.exchange))
        arrivals = Arrivals(self.robots, self.body_watch, sink)
        stages.append(arrivals)
        self._before, self._after, self._settle = (
            with_method(stages, method) for method in ("before", "after", "settle")
        )
        self._recorder = RecordPacker(self.robots, self.exchange, records, now)
        self._buses = tuple(ports)
        #: By index the bus of a robot that has all of its axes on one.
        self._one_bus = [next(iter(on)) if len(on) == 1 else None for on in self.exchange.requests.axes_on]
        self._orders = OrderHandler(
            self.robots, self.selector, self.exchange, together, stages, sink, self._fail
        )
        going_back = {} if contacts is None else contacts.going_back
        self._outcomes = Outcomes(self.robots, self.selector, self.exchange, going_back, arrivals, sink)
        self._rate_hz = rate_hz
        self._step = -1

    @property
    def preparing(self) -> bool:
        """True when a request to devices may have made the last tick longer than a period.

        No robot moves, and one connects or arms, or a bus carried out a request (clear, disable, open).
        """
        robots = self.robots
        return not robots.moving and (robots.preparing or self.exchange.requested)

    def arm(self) -> None:
        """Connect and arm every robot and follow the source."""
        self._begin(transitions.resume)

    def connect(self) -> None:
        """Connect every robot and leave it READY, without torque, until it is resumed."""
        self._begin(transitions.connect)

    def _begin(self, how: Order) -> None:
        self.robots.order(None, how, 0.0)
        self.robots.report_changes(0)

    def obey(self, message: object, tick_number: int) -> None:
        """Carry out a message of the daemon; a refusal becomes an event, and so does a defect."""
        self.robots.begin_tick(tick_number)
        self._refusals.order = self._orders.number
        try:
            step, rate_hz = self._step + 1, self._rate_hz
            self._orders.obey(message, tick_number, step, step / rate_hz, (tick_number - step) / rate_hz)
        except Exception as error:
            name = type(message).__name__.lower()
            robot = getattr(message, "robot", "")
            self._sink.event(OrderRefused(robot=robot, message=f"{name}: {type(error).__name__}: {error}"))
        self._refusals.order = 0
        self._outcomes.end_replaced(tick_number)

    def cycle(self, timing: Timing) -> None:
        """One tick of everything."""
        robots, selector, exchange = self.robots, self.selector, self.exchange
        self.costs.began_s = self.costs.now()
        robots.begin_tick(timing.tick)
        # The time of the robots counts the ticks that ran, not the skipped ones.
        step = self._step = timing.tick - timing.skipped
        now_s = step / self._rate_hz
        source = selector.source
        live = isinstance(source, Live)
        with self.costs.watched:
            targets = selector.targets(step, now_s, timing.skipped / self._rate_hz)
            for stage in self._before:
                try:
                    targets = stage.before(targets, timing, now_s)
                except Exception as error:  # an error in a stage must not stop the robots of others
                    self._fail(stage, error, now_s)
            outcomes = self._ticks(targets, now_s, live)
        for stage in self._after:
            try:
                stage.after(outcomes, targets, now_s)
            except Exception as error:
                self._fail(stage, error, now_s)
                self._tick_again(stage, outcomes, now_s)
        commands: dict[str, dict[str, float]] = {name: {} for name in self._buses}
        bus_of, one_bus = exchange.bus_of, self._one_bus
        self._outcomes.end_replaced(timing.tick)
        for index, (config, outcome) in enumerate(zip(robots.configs, outcomes, strict=True)):
            self._outcomes.take(index, timing.tick, outcome, targets.get(config.name))
            if (bus := one_bus[index]) is not None:
                commands[bus].update(zip(config.axes, outcome.device, strict=False))
                continue
            for axis, value in zip(config.axes, outcome.device, strict=False):
                commands[bus_of[axis]][axis] = value
        # The commands of this tick are fixed: a stop that begins now begins at the time of the next.
        next_s = (step + 1) / self._rate_hz
        exchange.run(commands, timing, next_s)
        for stage in self._settle:
            try:
                stage.settle(next_s)
            except Exception as error:
                self._fail(stage, error, next_s)
        selector.watch(timing.tick, step, next_s)
        robots.report_changes(timing.tick)
        source_s = None if source is None else source.time_s
        self._recorder.record(timing, now_s, source_s, targets, outcomes)
        if selector.finishing and not self.finished:
            self.finished = robots.resting and not exchange.busy and self.body_watch.settled
        self.costs.ended_s = self.costs.now()

    def _ticks(self, targets: Mapping[str, Target | None], now_s: float, live: bool) -> list[TickResult]:
        """The ticks of all robots; a model that does not answer is a fault of its robot."""
        robots, samples_of, costs = self.robots, self.exchange.samples_of, self.costs
        outcomes: list[TickResult] = []
        at_s = costs.now()
        measured = robots.measured
        for index, (config, state) in enumerate(zip(robots.configs, robots.states, strict=True)):
            name = config.name
            try:
                if robots.overran:
                    robots.raise_unanswered(index)
                costs.begin(index)
                outcome = tick(
                    config, state, now_s, samples_of(config), targets.get(name), measured.get(name), live=live
                )
                costs.running = -1
            except UnansweredError as error:
                robots.note_unanswered(index, error)
                failed = transitions.fail(config, state, error.fault, str(error), now_s)
                outcome = stop_without_model(config, failed, now_s)
            outcomes.append(outcome)
            before_s, at_s = at_s, costs.now()
            costs.robots_s[index] = at_s - before_s
        costs.robot_at_work[0] = 0
        return outcomes

    def _fail(self, stage: TickStage, error: Exception, now_s: float) -> None:
        """An error in a stage is a fault of its robots that are not OFF; they stop by their policy."""
        message = f"{type(stage).__name__}: {type(error).__name__}: {error}"
        for index in stage.robots:
            if self.robots.states[index].mode is not Mode.OFF:
                self.robots.fail(index, Fault.INTERNAL, message, now_s)

    def _tick_again(self, stage: TickStage, outcomes: list[TickResult], now_s: float) -> None:
        """The ticks of the robots of a stage that failed after them, from their states with the fault."""
        for index in stage.robots:
            config, state = self.robots.configs[index], self.robots.states[index]
            outcomes[index] = tick_again(config, state, now_s, self.exchange.samples_of(config))
