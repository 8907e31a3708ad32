"""One cycle of the whole robot file: targets, the tick of every robot, the exchange with every bus, a record.

The control process calls `Engine.cycle` at every deadline, virtual mode in a plain loop; the constructor gets
what differs between them: clock, ports and sink.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

from contid.clearance.guard import ClearanceGuard
from contid.control.engine.chain_monitor import ChainMonitor
from contid.control.engine.clearance_watch import ClearanceWatch
from contid.control.engine.contact_orders import ContactOrders
from contid.control.engine.cycle import OnEnd, Sink, Timing
from contid.control.engine.exchange import Exchange
from contid.control.engine.load_watch import LoadWatch
from contid.control.engine.order_handler import OrderHandler
from contid.control.engine.outcomes import Outcomes
from contid.control.engine.pack_record import RecordPacker
from contid.control.engine.ports import BusPort
from contid.control.engine.robots import Order, Robots
from contid.control.engine.sources import Timed
from contid.control.engine.target_selector import TargetSelector
from contid.control.tick import transitions
from contid.control.tick.config import RobotConfig
from contid.control.tick.robot_tick import TickResult, tick
from contid.kinematics.rope.chain import ChainGuard
from contid.targets import Target
from contid.trajectory.timed import Trajectory


class Engine:
    """The robots, their buses and their source of targets.

    Attributes:
        robots: with their configurations, states and statistics.
        exchange: with the buses.
        selector: of the source of targets.
        finished: every robot rests after the end of the source, or after an order to finish.
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
        guards: Sequence[ChainGuard] = (),
        clearance: ClearanceGuard | None = None,
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
            guards: of the closed chains among the robots.
            clearance: what keeps bodies apart, None without.
        """
        self.finished = False
        self.robots = Robots(configs, sink)
        self.exchange = Exchange(self.robots, ports, rate_hz, sink, now)
        self._chains = ChainMonitor(guards, self.robots, self.exchange, sink)
        self.selector = TargetSelector(self.robots, self._chains, rate_hz, sink, trajectory, on_end, attended)
        self._clearance = (
            None if clearance is None else ClearanceWatch(clearance, self.robots, self.exchange, sink)
        )
        self._loads = LoadWatch(self.robots, self.exchange)
        self._contacts = ContactOrders(self.robots, self.exchange, self._loads, self._chains, sink)
        self._recorder = RecordPacker(self.robots, self.exchange, sink, now)
        self._buses = tuple(ports)
        self._orders = OrderHandler(
            self.robots, self.selector, self.exchange, self._chains, self._contacts, self._loads,
            rate_hz, sink,
        )  # fmt: skip
        self._outcomes = Outcomes(self.robots, self.selector, self.exchange, self._contacts, rate_hz, sink)
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
        """Carry out a message of the daemon; a refusal becomes an event."""
        self._orders.obey(message, tick_number, self._step + 1)

    def cycle(self, timing: Timing) -> None:
        """One tick of everything."""
        robots, selector, exchange = self.robots, self.selector, self.exchange
        self._outcomes.begin(timing)
        # The time of the robots counts the ticks that ran, not the skipped ones.
        step = self._step = timing.tick - timing.skipped
        now_s = step / self._rate_hz
        source = selector.source
        targets = selector.targets(step, now_s)
        if self._clearance is not None:
            targets = self._clearance.before_tick(targets)
        if self._chains.chains:
            targets = self._chains.before_tick(targets, now_s, selector.measured)
        self._loads.tick(now_s, selector.measured)
        self._contacts.tick(timing.tick, now_s, selector.measured)
        targets = self._loads.loaded(targets, now_s)
        commands: dict[str, dict[str, float]] = {name: {} for name in self._buses}
        bus_of = exchange.bus_of
        outcomes = [
            self._computed(index, now_s, targets.get(config.name))
            for index, config in enumerate(robots.configs)
        ]
        too_near: Collection[int] = ()
        if self._clearance is not None:
            timed = isinstance(source, Timed)
            too_near = self._clearance.after_tick(outcomes, targets, now_s, timed)
        for index, config in enumerate(robots.configs):
            outcome = outcomes[index]
            self._outcomes.take(index, timing.tick, outcome, targets.get(config.name), index in too_near)
            for axis, value in zip(config.axes, outcome.device, strict=False):
                commands[bus_of[axis]][axis] = value
        # The commands of this tick are fixed: a stop that begins now begins at the time of the next.
        next_s = (step + 1) / self._rate_hz
        exchange.run(commands, timing, next_s)
        if self._chains.chains:
            self._chains.after_tick(next_s)
        selector.watch(timing.tick, step, next_s)
        robots.report_changes(timing.tick)
        source_s = None if source is None else source.time_s
        measured, loads = selector.measured, self._loads.in_world
        self._recorder.record(timing, now_s, source_s, targets, outcomes, measured, loads)
        if selector.finishing and not self.finished:
            self.finished = robots.resting and not exchange.busy

    def _computed(self, index: int, now_s: float, target: Target | None) -> TickResult:
        """The tick of one robot."""
        config, state = self.robots.configs[index], self.robots.states[index]
        measured = self.selector.measured.get(config.name)
        return tick(config, state, now_s, self.exchange.samples_of(config), target, measured)
