"""Every bus once per tick: sends commands and requests to the devices, takes their samples.

1. `DeviceRequests.ask` queues what is pending of a robot, on every bus that has axes of it.
2. `Exchange.run` gives each idle bus one job: the queued requests, then the exchange of commands and samples.
3. The reply of the bus names the requests that its devices carried out or refused. A robot whose buses have
   all carried one out goes on (`_done`): it is armed, or leaves its fault.

A bus that is *lost* gets no job but an attempt to open it, once a second.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final

from contid.control.engine.cycle import Sink, Timing
from contid.control.engine.device_requests import DeviceRequests
from contid.control.engine.events.buses import BusChanged, BusStalled, DeviceFaultChanged
from contid.control.engine.events.robots import OrderRefused
from contid.control.engine.order_events import answer_event
from contid.control.engine.ports import BusJob, BusPort, BusReply
from contid.control.engine.robots import Robots
from contid.control.engine.staleness import StalenessMonitor
from contid.control.engine.tick_costs import TickCosts
from contid.control.tick import fault_exits
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault
from contid.control.tick.state import Effect, OrderRefusedError
from contid.control.tick.supervisor import REST_OF, Mode, stronger
from contid.hal import LimitsEffort, Rest, Sample

#: Interval between two attempts to reopen a lost bus.
RETRY_S: Final = 1.0
#: Shortest wait for the buses with workers of their own, together, as a share of the period.
MIN_SHARE: Final = 0.25


class Exchange:
    """The buses of a run, the requests queued for them and their newest samples.

    Attributes:
        samples: newest by axis.
        bus_of: by axis, the name of its bus.
        requests: to the devices of the robots.
        effort_shares: to which the effort of robots was limited last, by name.
        unrested: indices of robots whose devices were asked to rest, and a bus is still at it after the tick.
    """

    def __init__(
        self,
        robots: Robots,
        ports: Mapping[str, BusPort],
        rate_hz: float,
        sink: Sink,
        costs: TickCosts,
    ) -> None:
        """Prepare; arguments as in `contid.control.engine.engine.Engine`, and where times are written."""
        self.samples: dict[str, Sample] = {}
        self.effort_shares: dict[str, float] = {}
        self.unrested: set[int] = set()
        self.bus_of = {axis: name for name, port in ports.items() for axis in port.bus.axes}
        self._robots = robots
        self._ports = dict(ports)
        self._rate_hz = rate_hz
        self._sink = sink
        self._now = costs.now
        self._costs = costs
        self._tick = 0
        self.requests = DeviceRequests(robots, ports, self.bus_of, sink)
        self._device_faults: dict[str, str] = {}
        self._staleness = StalenessMonitor(
            {name: tuple(port.bus.axes) for name, port in ports.items()}, rate_hz, sink
        )

    @property
    def busy(self) -> bool:
        """True while a bus that is not lost has an answer or a queued request outstanding."""
        return any(
            (port.busy or self.requests.queued[name]) and not port.lost for name, port in self._ports.items()
        )

    @property
    def requested(self) -> bool:
        """True when the newest job of a bus without a worker held a request besides its exchange."""
        return any(port.exempt and not port.threaded for port in self._ports.values())

    def samples_of(self, config: RobotConfig) -> tuple[Sample, ...]:
        """Newest sample of every axis of a robot; empty before the first exchange."""
        try:
            return tuple(map(self.samples.__getitem__, config.axes))
        except KeyError:  # before the first exchange of one of its buses
            return ()

    def limit_effort(self, who: Sequence[str] | None, share: float) -> dict[str, bool]:
        """Limit the effort of robots by name (None: all); by robot, whether it has an axis for it."""
        limited = {}
        for index, config in enumerate(self._robots.configs):
            if who is not None and config.name not in who:
                continue
            self.effort_shares[config.name] = share
            on_buses = [
                self._limit_on(config.name, name, axes, share)
                for name, axes in self.requests.axes_on[index].items()
            ]
            limited[config.name] = any(on_buses)
        return limited

    def _limit_on(self, robot: str, name: str, axes: Sequence[str], share: float) -> bool:
        """Limit the effort of axes of a robot on one bus; whether the bus has an axis for it."""
        bus = self._ports[name].bus
        if not isinstance(bus, LimitsEffort):
            return False
        try:
            shares = {axis: share for axis in axes if axis in bus.effort_limits()}
            bus.limit_effort(shares)
        except Exception as error:
            message = f"{robot}: {name}: {type(error).__name__}: {error}"
            self._sink.event(OrderRefused(robot=robot, message=message))
            return False
        return bool(shares)

    def run(self, commands: Mapping[str, Mapping[str, float]], timing: Timing, now_s: float) -> None:
        """One exchange with every idle bus; ``commands`` by bus and axis."""
        self._tick = timing.tick
        self.unrested.clear()
        now, buses_s = self._now, self._costs.buses_s
        at_s = now()
        # 1. A job for every idle bus; one without a worker is done when `start` returns.
        for name, port in self._ports.items():
            buses_s[name] = 0.0
            if port.busy:
                continue
            if port.lost:
                if timing.tick >= port.retry_at:
                    port.retry_at = timing.tick + max(int(RETRY_S * self._rate_hz), 1)
                    self.requests.of_job(name, reopens=True)
                    port.start(BusJob({}, reopen=True))
                continue
            requests = self.requests.of_job(name) if self.requests.queued[name] else ()
            port.start(BusJob(commands[name], requests))
            before_s, at_s = at_s, now()
            buses_s[name] = at_s - before_s
        # 2. The replies, by one deadline for all buses; in a late tick they get a share of the period, too.
        end_s = max(timing.end_s, at_s + MIN_SHARE / self._rate_hz)
        for name, port in self._ports.items():
            timeout_s = max(end_s - now(), 0.0) if port.threaded and not port.lost else 0.0
            if port.busy and (answer := port.take(timeout_s)) is not None:
                self._take_over(name, port, answer, now_s)
            elif port.busy and not port.lost:
                self._stalled(name, port, now_s)
            if (port.busy or self.requests.queued[name]) and not port.lost:
                self.unrested.update(self.requests.rests_of(name, port.busy))
        # 3. How old the samples are now.
        after_s = now()
        self._costs.waited_s = min(after_s, end_s) - at_s
        self._staleness.classify(timing.tick, self.samples, after_s)

    def abandon(self) -> None:
        """After an internal error: try to bring the devices to their ``on_host_loss`` rest.

        The stop of a robot that still brakes may leave less power than that. A rest that was asked for and
        not sent yet, such as that of an emergency stop, comes after it.
        """
        for index, config in enumerate(self._robots.configs):
            state = self._robots.states[index]
            powered = state.enabled or state.mode is Mode.ARMING
            policy = stronger(config.stops.on_host_loss, state.policy)
            for name, axes in self.requests.axes_on[index].items():
                queued = [effect for robot, effect, _ in self.requests.queued[name] if robot == index]
                rests = [each.value for each in (*queued, *state.pending) if isinstance(each.value, Rest)]
                for rest in [*([REST_OF[policy]] if powered else []), *rests]:
                    with suppress(Exception):
                        self._ports[name].rest(axes, rest)

    def _take_over(self, name: str, port: BusPort, answer: BusReply, now_s: float) -> None:
        """New samples, and what became of the requests to the devices, or that the bus is lost."""
        if answer.lost or answer.done or answer.refused or port.lost:
            self._sink.event(answer_event(answer, name, self._tick))
        if answer.lost:
            if not port.lost:
                self._lose(name, port, answer.fault, answer.lost, now_s)
            return
        if port.lost:
            port.lost = ""
            self._sink.event(BusChanged(bus=name, message=f"{name} is back; clear-fault, then resume"))
        if answer.done or answer.refused:
            self.requests.answered(name)
        assert answer.samples is not None
        self._keep(port, answer.samples)
        for index, effect in answer.done:
            if self.requests.carried_out(name, index):
                self._done(index, effect, now_s)
        for index, effect, message in answer.refused:
            self.requests.refused(name, index)
            if effect is Effect.ENABLE and self._robots.states[index].mode is Mode.ARMING:
                self._robots.fail(index, Fault.ARM_REFUSED, message, now_s)
            else:
                robot = self._robots.configs[index].name
                self._sink.event(OrderRefused(robot=robot, message=message))

    def _keep(self, port: BusPort, samples: Mapping[str, Sample]) -> None:
        """Keep the samples of a bus, without numbers that are not finite; events name changed faults."""
        if len(samples) < len(port.bus.axes):  # missing axes have no sample of this tick
            self._invalidate(port)
        self.samples.update(samples)
        for axis, sample in samples.items():
            if sample.valid and (sample.value is None or not math.isfinite(sample.value)):
                self.samples[axis] = replace(sample, value=None, valid=False)
            elif sample.effort is not None and not math.isfinite(sample.effort):
                self.samples[axis] = replace(sample, effort=None)  # a sum of currents would stay NaN
            if sample.fault != self._device_faults.get(axis, ""):
                self._device_faults[axis] = sample.fault
                self._sink.event(DeviceFaultChanged(tick=self._tick, axis=axis, fault=sample.fault))

    def _done(self, index: int, effect: Effect, now_s: float) -> None:
        """All devices of a robot carried out a request: it is armed, or leaves its fault."""
        robots = self._robots
        config, state = robots.configs[index], robots.states[index]
        if effect is Effect.ENABLE and state.mode is Mode.ARMING:
            robots.states[index] = replace(state, enabled=True)
        elif effect is Effect.CLEAR:
            try:
                robots.states[index] = fault_exits.clear(config, state, self.samples_of(config), now_s)
            except OrderRefusedError as error:
                self._sink.event(OrderRefused(robot=config.name, message=str(error)))

    def _lose(self, name: str, port: BusPort, fault: Fault, message: str, now_s: float) -> None:
        """A bus is lost: its robots fail, and what was to take power away is sent again when it is back.

        All devices of such a robot come to rest, by its ``on_fault`` or the stop that ran: those on other
        buses at once, those on this one when it is back, or before by their own watchdog.
        """
        port.lose(message)
        self.requests.keep_for_return(name)
        self._invalidate(port)
        for index in self._robots_on(name):
            self.requests.refused(name, index)
            state, config = self._robots.states[index], self._robots.configs[index]
            if state.mode is Mode.FAULT:  # its braking ends
                self._robots.states[index] = replace(state, enabled=False, motion=None, policy=None)
            elif state.mode is not Mode.OFF:
                self._robots.fail(index, fault, message, now_s)
            if state.enabled or state.mode is Mode.ARMING:
                self.requests.send(index, Effect(REST_OF[stronger(config.stops.on_fault, state.policy)]))

    def _stalled(self, name: str, port: BusPort, now_s: float) -> None:
        """A bus did not answer in time: a missed exchange for its robots; lost after ``tolerance_ticks``."""
        self._sink.event(BusStalled(tick=self._tick, bus=name))
        if port.exempt:
            return
        self._invalidate(port)
        mine = self._robots_on(name)
        tolerance = min(min(self._robots.configs[index].tolerance) for index in mine)
        if port.stalls >= tolerance and any(self._robots.states[index].enabled for index in mine):
            message = f"{name}: no answer for {port.stalls} ticks"
            self._lose(name, port, Fault.BUS_STALLED, message, now_s)

    def _robots_on(self, bus: str) -> list[int]:
        """Indices of the robots that have axes on a bus."""
        return [index for index, axes in enumerate(self.requests.axes_on) if bus in axes]

    def _invalidate(self, port: BusPort) -> None:
        """Mark the newest samples of a bus as not of this tick."""
        for axis in port.bus.axes:
            if axis in self.samples:
                self.samples[axis] = replace(self.samples[axis], valid=False)
