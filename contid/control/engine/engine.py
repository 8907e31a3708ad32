"""One cycle of the whole robot file: targets, the tick of every robot, the exchange with every bus, a record.

The control process calls `Engine.cycle` at every deadline, virtual mode in a plain loop; the constructor gets
what differs between them: clock, ports and sink.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from contid.clearance.guard import ClearanceGuard
from contid.control.engine import messages as msg
from contid.control.engine.chain_orders import ChainOrders
from contid.control.engine.clearance_orders import ClearanceOrders
from contid.control.engine.contact_orders import ContactOrders
from contid.control.engine.cycle import OnEnd, Sink, Timing
from contid.control.engine.events.orders import GotoEnded, MarkReached, OrderRefused
from contid.control.engine.events.robots import EffortLimited
from contid.control.engine.exchange import Exchange
from contid.control.engine.load_watch import LoadWatch
from contid.control.engine.order_events import order_event
from contid.control.engine.pack_record import CycleSnapshot, RecordPacker
from contid.control.engine.ports import BusPort
from contid.control.engine.robots import Order, Robots, stopping
from contid.control.engine.sources import Source, Timed
from contid.control.engine.stall_watch import StallWatch
from contid.control.engine.target_selector import TargetSelector
from contid.control.tick import transitions
from contid.control.tick.config import RobotConfig
from contid.control.tick.path_preflight import NEAR_M
from contid.control.tick.robot_tick import TickResult, tick
from contid.control.tick.state import Effect, RobotState
from contid.control.tick.statistics import RobotTally
from contid.control.tick.supervisor import Mode
from contid.control.tick.tip_feedback import Measurement
from contid.hal import Sample
from contid.kinematics.rope.chain import ChainGuard
from contid.targets import Target
from contid.trajectory.timed import Trajectory


class Engine:
    """The robots, their buses and their source of targets."""

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
        self._robots = Robots(configs, sink)
        self._exchange = Exchange(self._robots, ports, rate_hz, sink, now)
        self._chains = ChainOrders(guards, self._robots, self._exchange, sink)
        self._selector = TargetSelector(
            self._robots, self._chains, rate_hz, sink, trajectory, on_end, attended
        )
        self._clearance = ClearanceOrders(clearance, self._robots, self._exchange, sink)
        self._loads = LoadWatch(self._robots, self._exchange)
        self._contacts = ContactOrders(self._robots, self._exchange, self._loads, self._chains, sink)
        self._recorder = RecordPacker(self._robots.configs, sink, now)
        self._buses = tuple(ports)
        self._stalls = StallWatch(rate_hz)
        self._rate_hz = rate_hz
        self._sink = sink
        self._step = -1
        #: Goto of each robot in the tick before; a replaced one has ended.
        self._going: list[Target | None] = [None for _ in configs]

    @property
    def configs(self) -> Sequence[RobotConfig]:
        """Configuration of each robot."""
        return self._robots.configs

    @property
    def states(self) -> Sequence[RobotState]:
        """State of each robot."""
        return self._robots.states

    @property
    def tallies(self) -> Sequence[RobotTally]:
        """Statistics of each robot."""
        return self._robots.tallies

    @property
    def samples(self) -> Mapping[str, Sample]:
        """Newest sample by axis."""
        return self._exchange.samples

    @property
    def source(self) -> Source | None:
        """The source of targets."""
        return self._selector.source

    @property
    def preparing(self) -> bool:
        """True when a request to devices may have made the last tick longer than a period.

        No robot moves, and one connects or arms, or a bus carried out a request (clear, disable, open).
        """
        robots = self._robots
        return not robots.moving and (robots.preparing or self._exchange.requested)

    @property
    def armed(self) -> bool:
        """True when every robot that was to be armed has its first command."""
        return self._robots.armed

    @property
    def ended(self) -> bool:
        """True when the source has ended."""
        return self._selector.ended

    def arm(self) -> None:
        """Connect and arm every robot and follow the source."""
        self._begin(transitions.resume)

    def connect(self) -> None:
        """Connect every robot and leave it READY, without torque, until it is resumed."""
        self._begin(transitions.connect)

    def _begin(self, how: Order) -> None:
        self._robots.order(None, how, 0.0)
        self._robots.report_changes(0)

    def abandon(self) -> None:
        """After an internal error: try to bring the devices to their ``on_host_loss`` rest."""
        self._exchange.abandon()

    def obey(self, message: object, tick_number: int) -> None:
        """Carry out a message of the daemon; a refusal becomes an event."""
        selector = self._selector
        step = self._step + 1
        if isinstance(message, msg.Go) and not selector.at_start:
            self._sink.event(OrderRefused(message=msg.NOT_AT_START))
            message = msg.Hold()
        if (order := order_event(message, tick_number)) is not None:
            self._sink.event(order)
        if not isinstance(message, msg.Goto):
            self._chains.begin_gotos(step / self._rate_hz)
        # A client that gives orders may give more: the run then waits even if every robot is in FAULT.
        selector.attended = selector.attended or not isinstance(
            message, msg.Rows | msg.Measured | msg.EndOfRows
        )
        if selector.finishing and isinstance(
            message, msg.Rows | msg.Resume | msg.Recover | msg.Goto | msg.Play
        ):
            # Nothing may delay the end of a run.
            if not isinstance(message, msg.Rows):
                robot = message.robot if isinstance(message, msg.Goto) else ""
                refusal = "the run is ending; motions are refused"
                self._sink.event(OrderRefused(robot=robot, message=refusal))
            return
        self._carry_out(message, tick_number, step)

    def _carry_out(self, message: object, tick_number: int, step: int) -> None:
        """Apply a message to robots, selector and chains."""
        robots, selector, chains = self._robots, self._selector, self._chains
        now_s = step / self._rate_hz
        if not isinstance(message, msg.Rows | msg.Measured | msg.EndOfRows | msg.Mark):
            self._contacts.cancel()
        match message:
            case msg.Rows(targets):
                selector.rows(targets, now_s)
            case msg.Measured(robot, tip_in_world, direction, age_s):
                selector.measured[robot] = Measurement(tip_in_world, now_s - age_s, direction)
            case msg.EndOfRows():
                selector.end_of_rows()
            case msg.Play(trajectory, waits):
                selector.play(trajectory, now_s, waits)
            case msg.Go():
                selector.go()
            case msg.Begin():
                selector.begin_rows(now_s)
            case msg.Mark(number):
                self._sink.event(MarkReached(number=number, tick=tick_number))
            case msg.Goto(robot, target, None) if chains.concerns(robot):
                chains.goto(robot, target)
            case msg.Goto(robot, target, force_n):
                target = self._loads.loaded_goto(robot, target)
                robots.order((robot,), lambda p, s, t: transitions.goto(p, s, target, t, force_n), now_s)
            case msg.Hold(who):
                selector.pause(who, step)
                robots.order(who, transitions.hold, now_s)
                chains.stopped(who, now_s)
            case msg.Resume(who):
                selector.resume(who)
                robots.order(who, transitions.resume, now_s)
            case msg.Stop(who, policy, reason):
                selector.pause(who, step)
                robots.order(who, stopping(policy, reason), now_s)
                chains.stopped(who, now_s)
            case msg.Estop(who):
                selector.pause(who, step)
                robots.order(who, transitions.estop, now_s)
                chains.stopped(who, now_s)
            case msg.Grip(share, who):
                self._limit_effort(who, share, tick_number)
            case msg.ClearFault(who):
                robots.order(who, transitions.ask_clear, now_s)
            case msg.Recover(who):
                robots.order(who, transitions.recover, now_s)
            case msg.Finish(policy, reason):
                selector.finish(policy, reason, now_s)

    def _limit_effort(self, who: msg.RobotNames, share: float, tick_number: int) -> None:
        """Limit the effort of robots; one named without an axis for it is a refusal."""
        limited = self._exchange.limit_effort(who, share)
        for name, done in limited.items():
            if done:
                self._sink.event(EffortLimited(tick=tick_number, robot=name, share=share))
            elif who is not None or not any(limited.values()):
                message = f"{name}: none of its axes is in a mode that limits its effort"
                self._sink.event(OrderRefused(robot=name, message=message))

    def cycle(self, timing: Timing) -> None:
        """One tick of everything."""
        robots, selector, exchange = self._robots, self._selector, self._exchange
        self._stalls.begin(timing)
        # The time of the robots counts the ticks that ran, not the skipped ones.
        step = self._step = timing.tick - timing.skipped
        now_s = step / self._rate_hz
        source = selector.source
        self._chains.begin_gotos(now_s)
        targets = self._clearance.before_tick(selector.targets(step, now_s))
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
        too_near = self._clearance.after_tick(outcomes, targets, now_s, selector)
        for index, config in enumerate(robots.configs):
            outcome = outcomes[index]
            self._take(index, timing.tick, outcome, targets.get(config.name), index in too_near)
            for axis, value in zip(config.axes, outcome.device, strict=False):
                commands[bus_of[axis]][axis] = value
        # The commands of this tick are fixed: a stop that begins now begins at the time of the next.
        next_s = (step + 1) / self._rate_hz
        exchange.run(commands, timing, next_s)
        self._chains.after_tick(next_s)
        selector.watch(timing.tick, step, next_s)
        robots.report_changes(timing.tick)
        source_s = None if source is None else source.time_s
        self._recorder.record(
            CycleSnapshot(
                timing,
                now_s,
                source_s,
                targets,
                outcomes,
                robots.states,
                exchange.samples,
                selector.measured,
                self._loads.in_world,
            )
        )
        if selector.finishing and not self.finished:
            self.finished = robots.resting and not exchange.busy

    def _computed(self, index: int, now_s: float, target: Target | None) -> TickResult:
        """The tick of one robot."""
        config, state = self._robots.configs[index], self._robots.states[index]
        measured = self._selector.measured.get(config.name)
        return tick(config, state, now_s, self._exchange.samples_of(config), target, measured)

    def _take(
        self, index: int, number: int, outcome: TickResult, target: Target | None, too_near: bool
    ) -> None:
        """Take over a tick; queues its request to the devices and reports the end of a goto."""
        robots = self._robots
        config, state, tally = robots.configs[index], robots.states[index], robots.tallies[index]
        going, recovered = state.goto, state.recovering
        retreating = self._contacts.retreating(index)
        if self._going[index] is not None and self._going[index] is not going and not retreating:
            self._sink.event(GotoEnded(robot=config.name, arrived=False, tick=number))
        state = outcome.state
        if state.mode is Mode.FAULT and robots.reported[index] is not Mode.FAULT:
            state = self._stalls.explained(state, config.watchdog_s)
        if state.pending is not Effect.NONE:
            state = self._exchange.ask(index, state)
        if outcome.squeezed is not None:
            self._contacts.squeezed(config, number, outcome.squeezed)
        if going is not None and state.goto is None and not recovered:
            arrived = state.mode is Mode.HOLD and not too_near and not retreating and outcome.arrived
            self._sink.event(GotoEnded(robot=config.name, arrived=arrived, tick=number))
        if not retreating or (going is not None and state.goto is None):
            self._going[index] = None if state.recovering else state.goto
        robots.states[index] = state
        if outcome.solution is not None:
            source = self._selector.source
            timed = source is not None and source.time_s is not None
            tally.add(outcome.tip_error_m, outcome.solution.converged, outcome.solution.residual_m)
            if outcome.solution.converged or outcome.solution.residual_m <= NEAR_M:
                off_m = outcome.tip_error_m - outcome.solution.residual_m
                tally.on_path(off_m, state.command != state.reference, timed, state.since_s)
            else:  # the nearest point, which may jump
                tally.off_path(_behind_m(config, state, target))
                # A correction by measured tips may lead out of the reach that was checked.
                if isinstance(source, Timed) and source.within_reach and not config.departs:
                    tally.missed(outcome.solution.residual_m)
        for bits in outcome.limits:
            if bits:
                tally.limited[bits] += 1


def _behind_m(config: RobotConfig, state: RobotState, target: Target | None) -> float:
    """Distance of the commanded tip from that of the model's answer [m]."""
    if target is None or state.command == state.reference:
        return 0.0
    forward, load_n = config.model.forward, config.frame.vector_in_base(target.load_n)
    return math.dist(forward(state.command, load_n).tip_m, forward(state.reference, load_n).tip_m)
