"""The simulated bus: `contid.hal.Bus` over simulated devices.

Nothing runs in the background. Each call advances the devices to the clock's time, event by event, so that
edges of faults and trips of watchdogs happen at their own instants. With a virtual clock and a seed the run
is deterministic to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from contid.errors import ContidError, DeviceError, DeviceLostError, DeviceNotFoundError
from contid.hal import AxisOnBus, Clock, DeviceKind, Rest, Sample, TipMeasured
from contid.robot_file.rack_finger import RackFinger
from contid_drivers.sim.bodies import DamagesBodies, LoadedShafts, TracksTip, body_faults, shafts, tracked
from contid_drivers.sim.devices import SimDevice
from contid_drivers.sim.faults import Switches, append_event
from contid_drivers.sim.options import MECHANICAL, FaultKind, SimAxisOptions, SimBusOptions

if TYPE_CHECKING:
    from pydantic import BaseModel


class SimBus:
    """A `contid.hal.Bus` of simulated devices."""

    def __init__(self, name: str, options: SimBusOptions, axes: Sequence[AxisOnBus], clock: Clock) -> None:
        self.name = name
        self.axes = tuple(axis.name for axis in axes)
        self._options = options
        self._clock = clock
        self._watchdog_s = options.watchdog_ms / 1e3
        self.switches = Switches()
        #: The mechanical faults that are on; None before the first one.
        self._body_faults: DamagesBodies | None = None
        #: When `open` was called first; times of the robot file count from it.
        self._opened_s: float | None = None
        self._open = False
        self._lost = ""
        self._enabled: set[str] = set()
        self._missed: dict[str, Rest] = {}  # rests of axes that did not answer
        self._samples: dict[str, Sample] = {}
        self.arms: list[TracksTip] = []
        self.fingers: list[LoadedShafts] = []
        now = clock.now()
        self.devices = {axis.name: _device(name, options, axis, now) for axis in axes}
        for fault in options.faults:
            for axis in filter(None, (fault.axis, fault.other)):
                device = self._device(axis)
                if fault.kind in MECHANICAL:
                    self._faults_of_bodies().refuse_unit(fault, device)

    # -- the contract ------------------------------------------------------------------------------------

    def open(self) -> None:
        """See `contid.hal.Bus.open`; a silent axis counts as missing."""
        now = self._advance()
        if self._open:
            return
        if self._opened_s is None:
            self._opened_s = now
            for fault in self._options.faults:
                self.switches.schedule(fault, now)
            self._advance()
        if self.switches.is_on(FaultKind.LOST):
            raise DeviceNotFoundError(self.name, "the simulated bus is unplugged", "end the fault 'lost'")
        missing = [axis for axis in self.axes if self._silent(axis)]
        if missing:
            raise DeviceNotFoundError(
                self.name, f"expected {', '.join(self.axes)}; no answer from {', '.join(missing)}"
            )
        self._open, self._lost = True, ""
        self._samples = {axis: Sample(None, now, False, 0.0) for axis in self.axes}
        self._note("open", now)

    def enable(self, axes: Sequence[str]) -> None:
        """Make axes ready to move without moving them: goal := present, torque on, watchdog armed."""
        now = self._advance_open()
        for axis in axes:
            device = self._answering(axis)
            if device.fault:
                raise DeviceError(axis, device.fault, "clear the fault first")
        for axis in axes:
            if axis not in self._enabled:
                self.devices[axis].switch_on(now)
                self._enabled.add(axis)
                self._missed.pop(axis, None)
        self._note("enable", now, ", ".join(axes))

    def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        """Send the commands of a tick, and read every axis (`contid.hal.Bus.exchange`)."""
        for axis, value in commands.items():
            self._device(axis)
            if not math.isfinite(value):
                raise DeviceError(axis, f"a command must be finite, got {value!r}")
        now = self._advance_open()
        if self._missed:
            self._settle()
        latency_s = self._options.latency_ms / 1e3
        if not self.switches.on and latency_s <= 0.0:
            return self._exchanged_soundly(commands, now)
        bodies = self._body_faults
        for axis, value in (commands if bodies is None else bodies.commands(commands)).items():
            if axis in self._enabled and not self._silent(axis):
                self.devices[axis].command(value)
        for axis, device in self.devices.items():
            if not self._silent(axis) and not self.switches.is_on(FaultKind.STALE, axis):
                sample = device.read(now)
                self._samples[axis] = sample if bodies is None else bodies.seen(axis, sample)
        end = self._wait(now, latency_s + self.switches.delay_s)
        for axis, device in self.devices.items():
            answered = not self._silent(axis)
            if answered:
                device.fed_at_s = end
            sample = self._samples[axis]
            valid = answered and sample.value is not None
            if sample.time_s != end or sample.valid != valid:
                # Written out: `replace` costs three times as much, here for every axis in every tick.
                self._samples[axis] = Sample(
                    sample.value, sample.time_s, valid, end - sample.time_s, sample.velocity, sample.effort,
                    sample.temperature_c, sample.voltage_v, sample.fault,
                )  # fmt: skip
        return dict(self._samples)

    def _exchanged_soundly(self, commands: Mapping[str, float], now: float) -> Mapping[str, Sample]:
        """An exchange without any fault or latency, in half of the time: nearly every one."""
        enabled, devices = self._enabled, self.devices
        for axis, value in commands.items():
            if axis in enabled:
                devices[axis].command(value)
        samples = {}
        for axis, device in devices.items():
            samples[axis] = device.read(now)
            device.fed_at_s = now
        self._samples = samples
        return dict(samples)

    def disable(self, axes: Sequence[str], rest: Rest) -> None:
        """Bring axes to a state of rest; does not raise for a lost device (`contid.hal.Bus.disable`)."""
        for axis in axes:
            self._device(axis)
        self._enabled.difference_update(axes)
        now = self._advance()
        self._missed.update(dict.fromkeys(axes, rest))
        if self._open:
            self._settle()
            self._note("disable", now, ", ".join(axes))

    def _settle(self) -> None:
        """Bring the axes that answer to the rest they were asked for; the others do when they answer."""
        for axis in [axis for axis in self._missed if not self._silent(axis)]:
            self.devices[axis].settle(self._missed.pop(axis))

    def clear_fault(self, axes: Sequence[str]) -> None:
        """Clear latched device faults without motion; raises `DeviceError` if one persists."""
        now = self._advance_open()
        for axis in axes:
            device = self._answering(axis)
            if device.fault and self.switches.is_on(FaultKind.OVERLOAD, axis):
                raise DeviceError(axis, f"{device.fault} persists")
        for axis in axes:
            if self.devices[axis].fault:
                self.devices[axis].fault = ""
                self._enabled.discard(axis)
        self._note("clear_fault", now, ", ".join(axes))

    def close(self) -> None:
        """Close the port. Idempotent; never changes torque (`contid.hal.Bus.close`)."""
        now = self._advance()
        self._enabled.clear()
        if self._open:
            self._open = False
            self._note("close", now)
        self._lost = ""

    # -- bodies ------------------------------------------------------------------------------------------

    def carry(self, robot: str, description: BaseModel) -> None:
        """Simulate the body of a robot whose axes it carries; called before `Bus.open`."""
        if isinstance(description, RackFinger):
            self.fingers.append(shafts(robot, description))
            return
        self.arms.append(tracked(robot, description))

    def measured_tips(self) -> Sequence[TipMeasured]:
        """What arrived since the last call, in the order of time; callable from any thread."""
        now = self._clock.now()
        return [tip for arm in self.arms for tip in arm.take_arrived(now)]

    def _faults_of_bodies(self) -> DamagesBodies:
        if self._body_faults is None:
            self._body_faults = body_faults(self.name)
        return self._body_faults

    # -- helpers -----------------------------------------------------------------------------------------

    def _device(self, axis: str) -> SimDevice:
        try:
            return self.devices[axis]
        except KeyError:
            raise DeviceError(
                axis, f"no such axis on bus {self.name}; axes: {', '.join(self.axes)}"
            ) from None

    def _silent(self, axis: str) -> bool:
        return self.switches.is_on(FaultKind.SILENT, axis) or self.switches.is_on(FaultKind.LOST)

    def _answering(self, axis: str) -> SimDevice:
        device = self._device(axis)
        if self._silent(axis):
            raise DeviceError(axis, "does not answer", "check its cable and its power")
        return device

    def _advance_open(self) -> float:
        """Advance the devices; raise if the bus is not open or lost."""
        now = self._advance()
        if not self._open:
            raise DeviceLostError(self.name, self._lost or "the bus is not open")
        return now

    def _wait(self, now: float, seconds: float) -> float:
        if seconds <= 0.0:
            return now
        self._clock.sleep(seconds)
        return self._advance()

    def _advance(self) -> float:
        now = self._clock.now()
        while (edge_s := self.switches.next_s) <= now:
            self._advance_devices(edge_s)
            edge = self.switches.take()
            if edge.kind is FaultKind.LOST and edge.on and self._open:
                self._open, self._lost = False, "the simulated bus was unplugged"
                self._enabled.clear()
            elif edge.kind is FaultKind.OVERLOAD and edge.on:
                self.devices[edge.axis].overload()
            elif edge.kind is FaultKind.STALL:
                self.devices[edge.axis].motion.blocked = edge.on
            elif edge.kind in MECHANICAL:
                self._faults_of_bodies().switch(edge.fault, edge.on, self.devices[edge.axis], edge_s)
            self._note(f"{edge.kind.value} {'begins' if edge.on else 'ends'}", edge_s, edge.axis)
        self._advance_devices(now)
        return now

    def _advance_devices(self, to_s: float) -> None:
        """Advance every device and body to ``to_s``; trackers capture at their own instants."""
        if self._opened_s is None:
            self._advance_to(to_s)
            return
        for arm in self.arms:
            while (capture_s := arm.next_capture_s(self._opened_s)) <= to_s:
                self._advance_to(capture_s)
                arm.capture(self._values(arm.axes), capture_s, capture_s - self._opened_s)
        self._advance_to(to_s)
        for arm in self.arms:
            arm.body.follow(self._values(arm.axes), to_s - self._opened_s)
        for finger in self.fingers:
            shafts = [self.devices[axis] for axis in finger.axes]
            settled = finger.settle(self._values(finger.axes), to_s - self._opened_s)
            for shaft, (angle, current_a) in zip(shafts, settled, strict=True):
                shaft.bear(angle, current_a, finger.noise_a)

    def _values(self, axes: Sequence[str]) -> list[float]:
        return [self.devices[axis].motion.value for axis in axes]

    def _advance_to(self, to_s: float) -> None:
        """Advance every device to ``to_s``; watchdogs trip at their own instants."""
        devices = self.devices.values()
        fed_at_s = min([device.fed_at_s for device in devices if device.on], default=math.inf)
        if fed_at_s + self._watchdog_s >= to_s:  # no watchdog trips in this time
            for axis, device in self.devices.items():
                if device.advance(to_s):
                    self._note(device.fault, to_s, axis)
            return
        while True:
            armed = [(d.fed_at_s + self._watchdog_s, axis) for axis, d in self.devices.items() if d.on]
            deadline, first = min(armed, default=(math.inf, ""))
            step_s = min(deadline, to_s)
            for axis, device in self.devices.items():
                if device.advance(step_s):
                    self._note(device.fault, step_s, axis)
            if deadline >= to_s:
                return
            device = self.devices[first]
            if device.on:
                device.trip(self._watchdog_s)
                self._note("trip", deadline, first)

    def _note(self, event: str, t_s: float, subject: str = "") -> None:
        if self._options.journal_file is not None:
            append_event(self._options.journal_file, event, t_s, self.name, self.devices, subject)


def _device(bus: str, options: SimBusOptions, axis: AxisOnBus, now: float) -> SimDevice:
    if not isinstance(axis.options, SimAxisOptions):
        got = type(axis.options).__name__
        raise ContidError(f"{axis.name}: options of a simulated axis expected, got {got}")
    start = axis.options.start
    if start is None:
        low, high = axis.travel or (0.0, 0.0)
        is_regulator = axis.options.device is DeviceKind.REGULATOR
        start = min(high, max(low, 0.0)) if is_regulator else 0.5 * (low + high)
    return SimDevice(axis.options, start, now, seed=f"{options.seed}:{bus}:{axis.name}")
