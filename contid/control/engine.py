"""One cycle of the whole robot file: targets, the tick of every robot, the buses, what came of it.

The control process calls `Engine.cycle` at every deadline, virtual mode in a plain loop; everything that
differs between them (time, threads, where records go) is given to the constructor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final

from contid.control import messages as msg
from contid.control import state as change
from contid.control.chain_watch import ChainWatch
from contid.control.cycle import OnEnd, Sink, Timing
from contid.control.faults import Fault, describe
from contid.control.journal import answer_event, order_events
from contid.control.loop import Outcome, tick
from contid.control.plan import RobotPlan
from contid.control.ports import Answer, Job, Port
from contid.control.recording import Recorder
from contid.control.sources import Live, Source, Timed
from contid.control.state import Effect, OrderRefusedError, RobotState
from contid.control.statistics import RobotTally
from contid.control.supervisor import MOVING, REST_OF, Mode
from contid.control.tip_feedback import Measurement
from contid.description.base import StopPolicy
from contid.hal import Sample
from contid.models.chain import ChainGuard
from contid.targets import Target
from contid.trajectory.timed import Trajectory

#: Between two attempts to open a lost bus again.
RETRY_S: Final = 1.0


#: Share of the period that a bus with its own worker is always waited for.
LEAST_SHARE: Final = 0.25


class Engine:
    """The robots, their buses and what they follow."""

    def __init__(
        self,
        plans: Sequence[RobotPlan],
        ports: Mapping[str, Port],
        rate_hz: float,
        sink: Sink,
        now: Any,
        *,
        trajectory: Trajectory | None = None,
        on_end: OnEnd = OnEnd.STOP,
        attended: bool = False,
        guards: Sequence[ChainGuard] = (),
    ) -> None:
        """Prepare; nothing is touched.

        Args:
            plans: of the robots, in file order.
            ports: by bus name; already open.
            rate_hz: of the tick.
            sink: takes records and events.
            now: the clock of the buses, as a function.
            trajectory: what to follow, None to wait for rows or orders.
            on_end: what to do when the source ends.
            attended: somebody may give orders: do not end because every robot is in FAULT.
            guards: of the closed chains among the robots.
        """
        self.plans = tuple(plans)
        self.states = [RobotState() for _ in plans]
        self.tallies = [RobotTally() for _ in plans]
        self.source: Source | None = None
        if trajectory is not None:
            self.source = Timed(trajectory, rate_hz, plans)
        self.finished = False
        self._index = {plan.name: index for index, plan in enumerate(plans)}
        self._ports = dict(ports)
        self._rate_hz = rate_hz
        self._sink = sink
        self._now = now
        self._on_end = on_end
        self._attended = attended
        self._finishing = False
        self._ended = False
        self._samples: dict[str, Sample] = {}
        self._measured: dict[str, Measurement] = {}
        self._step = -1
        port_of = {axis: name for name, port in ports.items() for axis in port.bus.axes}
        self._buses = [sorted({port_of[axis] for axis in plan.axes}) for plan in plans]
        self._axes_on = [
            {bus: tuple(axis for axis in plan.axes if port_of[axis] == bus) for bus in buses}
            for plan, buses in zip(self.plans, self._buses, strict=True)
        ]
        self._port_of = port_of
        self._queued: dict[str, list[tuple[int, Effect, tuple[str, ...]]]] = {name: [] for name in ports}
        self._outstanding: list[set[str]] = [set() for _ in plans]
        self._told = [Mode.OFF for _ in plans]
        self._going: list[Target | None] = [None for _ in plans]
        self._device_faults: dict[str, str] = {}
        self._tick = 0
        self._recorder = Recorder(self.plans, sink)
        self._chains = ChainWatch(guards, self.plans)
        self._gotos: dict[str, Target] = {}

    @property
    def moving(self) -> bool:
        """True while any robot may be in motion."""
        return any(state.mode in MOVING or any(state.steps) for state in self.states)

    @property
    def armed(self) -> bool:
        """True when no robot is on its way to its first command any more."""
        waiting = (Mode.OFF, Mode.CONNECTING, Mode.READY, Mode.ARMING)
        return not any(state.mode in waiting and state.wanted for state in self.states)

    @property
    def ended(self) -> bool:
        """True when what was followed has ended."""
        return self._ended

    def arm(self) -> None:
        """Connect, arm and follow, every robot: what `contid run` begins with."""
        self._begin(change.resume)

    def connect(self) -> None:
        """Connect every robot and leave it READY, without torque, until it is resumed."""
        self._begin(change.connect)

    def _begin(self, how: Callable[[RobotPlan, RobotState, float], RobotState]) -> None:
        for index, plan in enumerate(self.plans):
            self.states[index] = how(plan, self.states[index], 0.0)
            self._told[index] = self.states[index].mode
            self._announce(plan, self.states[index], 0)

    # -- orders ------------------------------------------------------------------------------------------

    def obey(self, message: object, tick_number: int) -> None:
        """Carry out a message of the daemon; what is refused becomes an event."""
        step = self._step + 1
        now_s = step / self._rate_hz
        for fields in order_events(message):
            self._sink.event("order", tick=tick_number, **fields)
        if not isinstance(message, msg.Goto):
            self._begin_gotos(now_s)
        # Whoever gives orders is waited for, also when every robot is in FAULT.
        self._attended = self._attended or not isinstance(message, msg.Rows | msg.Measured | msg.End)
        if self._finishing and isinstance(message, msg.Rows | msg.Resume | msg.Goto | msg.Play):
            # Nobody, and no script in a loop, holds up the end of a run.
            if not isinstance(message, msg.Rows):
                robot = message.robot if isinstance(message, msg.Goto) else ""
                self._sink.event("refused", robot=robot, words="the run is ending; nothing moves any more")
            return
        match message:
            case msg.Rows(targets):
                if not isinstance(self.source, Live):
                    self.source = Live()
                self.source.put(targets)
                for robot, target in targets.items():
                    if target is not None and target.measured_tip_m is not None:
                        self._measured[robot] = Measurement.of(target, now_s)
            case msg.Measured(robot, tip_in_world, direction, age_s):
                self._measured[robot] = Measurement(tip_in_world, now_s - age_s, direction)
            case msg.End():
                if not isinstance(self.source, Live):
                    self.source = Live()
                self.source.end()
            case msg.Play(trajectory):
                self._replace(Timed(trajectory, self._rate_hz, self.plans), now_s)
            case msg.Begin():
                self._replace(Live(), now_s)
            case msg.Mark(number):
                self._sink.event("mark", number=number, tick=tick_number)
            case msg.Goto(robot, target) if self._chains.concerns(robot):
                self._gotos[robot] = target  # looked at together with what comes with it
            case msg.Goto(robot, target):
                self._each((robot,), lambda p, s: change.goto(p, s, target, now_s))
            case msg.Hold(robots):
                self._pause(robots, step)
                self._each(robots, lambda p, s: change.hold(p, s, now_s))
                self._chain_stopped(robots, now_s)
            case msg.Resume(robots):
                if robots is None and self.source is not None:
                    self.source.resume()
                self._each(robots, lambda p, s: change.resume(p, s, now_s))
            case msg.Stop(robots, policy, reason):
                self._pause(robots, step)
                self._each(robots, lambda p, s: change.stop(p, s, policy or getattr(p.stops, reason), now_s))
                self._chain_stopped(robots, now_s)
            case msg.Estop(robots):
                self._pause(robots, step)
                self._each(robots, lambda p, s: change.estop(p, s, now_s))
                self._chain_stopped(robots, now_s)
            case msg.ClearFault(robots):
                self._each(robots, self._begin_clear)
            case msg.Finish(policy, reason):
                self.finish(policy, reason, now_s)

    def _begin_gotos(self, now_s: float) -> None:
        """Orders to points for arms of chains, as many as came together."""
        targets, self._gotos = self._gotos, {}
        for robot, words in self._chains.gotos(self.states, targets, now_s, self._samples_of):
            self._sink.event("refused", robot=robot, words=words)

    def _chain_stopped(self, robots: msg.Who, now_s: float) -> None:
        for robot, words in self._chains.stopped(self.states, robots, now_s, self._samples_of):
            self._sink.event("refused", robot=robot, words=words)

    def _pause(self, robots: msg.Who, step: int) -> None:
        """What stops everybody stops the time of the trajectory too."""
        if robots is None and self.source is not None:
            self.source.pause(step)

    def _replace(self, source: Source, now_s: float) -> None:
        """Another source takes over: whoever followed the old one approaches the new one, or holds."""
        self.source, self._ended, self._on_end = source, False, OnEnd.HOLD
        for index, plan in enumerate(self.plans):
            state = self.states[index]
            if state.mode is Mode.RUN or (state.mode is Mode.APPROACH and state.goto is None):
                self.states[index] = change.stay(plan, state, now_s)

    def finish(self, policy: StopPolicy | None, reason: str, now_s: float) -> None:
        """Stop every robot; `finished` becomes true when all of them rest."""
        self._finishing = True
        self.source = None
        for index, plan in enumerate(self.plans):
            if self.states[index].mode not in (Mode.OFF, Mode.FAULT):
                stops_by = policy or getattr(plan.stops, reason)
                self._order(index, lambda p, s, by=stops_by: change.stop(p, s, by, now_s))
            state = self.states[index]
            if state.mode is Mode.FAULT and state.enabled:
                # It stopped by its policy already; now the devices shall stay so without a host.
                resting = Effect(REST_OF[plan.stops.on_fault])
                self.states[index] = replace(state, pending=resting, enabled=False)
        self._chain_stopped(None, now_s)
        motions = [state.motion for state in self.states if state.mode is Mode.STOPPING]
        seconds = max((motion.duration_s for motion in motions if motion is not None), default=0.0)
        self._sink.event("stopping", reason=reason, seconds=seconds)

    def abandon(self) -> None:
        """After a defect of contid itself: bring the devices to their ``on_host_loss`` rest, best effort."""
        for index, plan in enumerate(self.plans):
            for name, axes in self._axes_on[index].items():
                port = self._ports[name]
                rest = REST_OF[plan.stops.on_host_loss]
                if not port.busy and self.states[index].enabled:
                    with suppress(Exception):
                        port.bus.disable(axes, rest)

    def _each(self, robots: msg.Who, order: Any) -> None:
        unknown = [name for name in robots or () if name not in self._index]
        for name in unknown:
            self._sink.event(
                "refused", robot=name, words=f"no robot {name!r}; there are {', '.join(self._index)}"
            )
        for name in robots if robots is not None else tuple(self._index):
            if name in unknown:
                continue
            try:
                self._order(self._index[name], order)
            except OrderRefusedError as error:
                # An order to everybody is not refused by those it does not concern.
                if robots is not None:
                    self._sink.event("refused", robot=name, words=str(error))

    def _order(self, index: int, order: Any) -> None:
        """Change the state of one robot; what goes wrong is that robot's fault, never the end of the others.

        Raises:
            OrderRefusedError: its state does not allow it.
        """
        plan, state = self.plans[index], self.states[index]
        try:
            self.states[index] = order(plan, state)
        except OrderRefusedError:
            raise
        except Exception as error:
            now_s = (self._step + 1) / self._rate_hz
            words = f"{type(error).__name__}: {error}"
            self.states[index] = change.fail(plan, state, Fault.INTERNAL, words, now_s)

    @staticmethod
    def _begin_clear(plan: RobotPlan, state: RobotState) -> RobotState:
        if state.mode is not Mode.FAULT:
            return change.clear(plan, state, (), 0.0)
        return replace(state, pending=Effect.CLEAR)

    # -- the cycle ---------------------------------------------------------------------------------------

    def cycle(self, timing: Timing) -> None:
        """One tick of everything."""
        number = self._tick = timing.tick
        # Robots live in steps, ticks that ran: skipped ones have not happened for them.
        step = self._step = timing.tick - timing.skipped
        now_s = step / self._rate_hz
        source = self.source
        self._begin_gotos(now_s)
        targets: Mapping[str, Target | None] = {} if source is None else source.targets(step)
        targets = self._chains.targets(targets, self.states)
        self._chains.begin(self.states, targets, now_s, self._samples_of, self._measured)
        source_is_timed = isinstance(source, Timed)
        commands: dict[str, dict[str, float]] = {name: {} for name in self._ports}
        outcomes: list[Outcome] = []
        port_of = self._port_of
        for index, plan in enumerate(self.plans):
            state = self.states[index]
            target = targets.get(plan.name)
            if target is not None and target.measured_tip_m is not None and source_is_timed:
                self._measured[plan.name] = Measurement.of(target, now_s)
            measured = self._measured.get(plan.name)
            going = state.goto
            if self._going[index] is not None and self._going[index] is not going:
                self._sink.event("goto", robot=plan.name, arrived=False, tick=number)
            outcome = tick(plan, state, now_s, self._samples_of(plan), target, measured)
            state = outcome.state
            if state.pending is not Effect.NONE:
                state = self._ask(index, state)
            for axis, value in zip(plan.axes, outcome.device, strict=False):
                commands[port_of[axis]][axis] = value
            if going is not None and state.goto is None:
                arrived = state.mode is Mode.HOLD
                self._sink.event("goto", robot=plan.name, arrived=arrived, tick=number)
            self._going[index] = state.goto
            self.states[index] = state
            outcomes.append(outcome)
            if outcome.solution is not None:
                self.tallies[index].add(outcome.tip_error_m, outcome.solution.converged)
            for bits in outcome.limits:
                if bits:
                    self.tallies[index].limited[bits] += 1
        self._exchange(commands, timing, now_s)
        self._chains.faults(self.states, self._told, now_s)
        self._watch_source(number, step, now_s)
        for index, state in enumerate(self.states):
            if state.mode is not self._told[index]:
                self._told[index] = state.mode
                self._announce(self.plans[index], state, number)
        self._recorder.record(
            timing, source, targets, outcomes, self.states, self._samples, self._measured, now_s, self._now
        )
        if self._finishing and not self.finished:
            resting = all(
                state.mode in (Mode.OFF, Mode.FAULT) and state.pending is Effect.NONE for state in self.states
            )
            # What is still queued for a bus that was late has not reached its devices.
            self.finished = resting and not any(
                (port.busy or self._queued[name]) and not port.lost for name, port in self._ports.items()
            )

    def _samples_of(self, plan: RobotPlan) -> tuple[Sample, ...]:
        samples = self._samples
        try:
            return tuple([samples[axis] for axis in plan.axes])
        except KeyError:  # before the first exchange of one of its buses
            return ()

    def _ask(self, index: int, state: RobotState) -> RobotState:
        """Queue what a robot wants of its devices."""
        lost = [bus for bus in self._axes_on[index] if self._ports[bus].lost]
        if lost and state.pending is Effect.CLEAR:
            words = f"{self.plans[index].name}: not cleared, {self._ports[lost[0]].lost}"
            self._sink.event("refused", robot=self.plans[index].name, words=words)
            return replace(state, pending=Effect.NONE)
        for bus, axes in self._axes_on[index].items():
            if bus in lost:
                continue
            self._queued[bus].append((index, state.pending, axes))
            self._outstanding[index].add(bus)
        return replace(state, pending=Effect.NONE)

    def _exchange(self, commands: Mapping[str, dict[str, float]], timing: Timing, now_s: float) -> None:
        for name, port in self._ports.items():
            if port.busy:
                continue
            if port.lost:
                if timing.tick >= port.retry_at:
                    port.retry_at = timing.tick + max(int(RETRY_S * self._rate_hz), 1)
                    port.start(Job({}, reopen=True))
                continue
            effects, self._queued[name] = tuple(self._queued[name]), []
            port.start(Job(commands[name], effects))
        for name, port in self._ports.items():
            patience_s = 0.0
            if port.threaded and not port.lost:
                # A tick that is late by itself is no reason to give up on a bus that was asked just now.
                patience_s = max(timing.end_s - self._now(), LEAST_SHARE / self._rate_hz)
            if port.busy and (answer := port.take(patience_s)) is not None:
                self._digest(name, port, answer, now_s)
            elif port.busy and not port.lost:
                self._stalled(name, port, now_s)

    def _digest(self, name: str, port: Port, answer: Answer, now_s: float) -> None:
        if answer.lost or answer.done or answer.refused or port.lost:
            self._sink.event("answer", tick=self._tick, bus=name, **answer_event(answer))
        if answer.lost:
            if not port.lost:
                self._lose(name, port, Fault.DEVICE_LOST, answer.lost, now_s)
            return
        if port.lost:
            port.lost = ""
            self._sink.event("bus", bus=name, words=f"{name} is back; clear-fault, then resume")
        assert answer.samples is not None
        self._samples.update(answer.samples)
        for axis, sample in answer.samples.items():
            if sample.fault != self._device_faults.get(axis, ""):
                self._device_faults[axis] = sample.fault
                self._sink.event("device", tick=self._tick, axis=axis, fault=sample.fault)
        for index, effect in answer.done:
            self._outstanding[index].discard(name)
            if not self._outstanding[index]:
                self._done(index, effect, now_s)
        for index, effect, words in answer.refused:
            self._outstanding[index].discard(name)
            plan, state = self.plans[index], self.states[index]
            if effect is Effect.ENABLE:
                self.states[index] = change.fail(plan, state, Fault.ARM_REFUSED, words, now_s)
            else:
                self._sink.event("refused", robot=plan.name, words=words)

    def _done(self, index: int, effect: Effect, now_s: float) -> None:
        plan, state = self.plans[index], self.states[index]
        if effect is Effect.ENABLE and state.mode is Mode.ARMING:
            self.states[index] = replace(state, enabled=True)
        elif effect is Effect.CLEAR:
            try:
                self.states[index] = change.clear(plan, state, self._samples_of(plan), now_s)
            except OrderRefusedError as error:
                self._sink.event("refused", robot=plan.name, words=str(error))

    def _lose(self, name: str, port: Port, fault: Fault, words: str, now_s: float) -> None:
        """A bus is gone: so are its robots; they keep nothing queued on any bus."""
        port.lose(words)
        self._queued[name] = []
        for axis in port.bus.axes:
            if axis in self._samples:
                self._samples[axis] = replace(self._samples[axis], valid=False)
        for index, plan in enumerate(self.plans):
            if name in self._axes_on[index]:
                self._outstanding[index].discard(name)
                if self.states[index].mode is not Mode.OFF:
                    self.states[index] = change.fail(plan, self.states[index], fault, words, now_s)

    def _stalled(self, name: str, port: Port, now_s: float) -> None:
        """A worker is not back in time: a missed exchange for its robots, lost when it goes on."""
        self._sink.event("stall", tick=self._tick, bus=name)
        if port.exempt:
            return
        for axis in port.bus.axes:
            if axis in self._samples:
                self._samples[axis] = replace(self._samples[axis], valid=False)
        armed = any(self.states[i].enabled and name in self._axes_on[i] for i in range(len(self.plans)))
        patience = min(min(p.tolerance) for i, p in enumerate(self.plans) if name in self._axes_on[i])
        if armed and port.stalls >= patience:
            words = f"{name}: no answer for {port.stalls} ticks"
            self._lose(name, port, Fault.BUS_STALLED, words, now_s)

    def _watch_source(self, number: int, step: int, now_s: float) -> None:
        if self._finishing:
            return
        source = self.source
        alive = any(state.mode is not Mode.FAULT for state in self.states)
        if source is not None:
            source.watch(step, {p.name: s for p, s in zip(self.plans, self.states, strict=True)})
            if source.finished and not self._ended:
                self._ended = True
                self._sink.event("end", tick=number, on_end=self._on_end.value)
                if self._on_end is not OnEnd.HOLD:
                    rest = StopPolicy.REST if self._on_end is OnEnd.REST else None
                    self.finish(rest, "on_end", now_s)
        if not alive and not self._attended and not self._finishing:
            self.finish(None, "on_fault", now_s)

    def _announce(self, plan: RobotPlan, state: RobotState, number: int) -> None:
        if state.mode is Mode.FAULT:
            words = describe(state.fault, state.words)
            self._sink.event(
                "fault",
                robot=plan.name,
                fault=int(state.fault),
                name=state.fault.name,
                words=words,
                detail=state.words,
                tick=number,
            )
        self._sink.event("state", robot=plan.name, mode=state.mode.name, tick=number)
