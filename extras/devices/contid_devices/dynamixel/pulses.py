"""Open-loop pulses of Dynamixel servos, for ``contid bringup``.

A pulse is a Goal PWM in PWM mode. The servo itself bounds it: the PWM Limit is 20 % meanwhile, so that
the Goal PWM, which a change of mode sets to that limit, is no more either; and its Bus Watchdog stops it one
unit of 20 ms after the last instruction. A host that dies within a pulse leaves that limit in the EEPROM; the
next bring-up takes `PROBE_PWM` for the factory's, and ``contid doctor`` names it. Source: e-manual of the X
series, registers 11, 36, 98 and 100.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from typing import Final, NamedTuple

from contid.errors import DeviceError
from contid.hal import AxisOnBus
from contid.hal.pulses import EncoderAnswer, ProvenDevice
from contid.kit.remembered import memory_of
from contid.kit.serial_ports import find_port
from contid_devices.dynamixel import search
from contid_devices.pulsed_motors import DriveFacts, PulseAnswer, TimedCount
from contid_drivers.dynamixel import arming, turns
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.checks import identity, left_over
from contid_drivers.dynamixel.checks.identity import servo_device
from contid_drivers.dynamixel.client import TRIES, NoAnswerError, ServoClient
from contid_drivers.dynamixel.grip import read_own_limit
from contid_drivers.dynamixel.link import handshake
from contid_drivers.dynamixel.models import NO_LOAD_RPM
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions
from contid_drivers.dynamixel.packets import sync_write
from contid_drivers.dynamixel.port import ServoPort

#: PWM Limit while servos are pulsed: 20 %.
PROBE_PWM: Final = 177
_PWM_FULL: Final = reg.PWM_LIMIT.default
_PWM_MODE: Final = 16
#: Time a trace covers after a pulse, pause between its reads; as many of them would fit before its end.
_TRACE_S: Final = 0.096
_POLL_S: Final = 0.002
_FREE: Final = 2.0
#: A trace ends when the servo stands for this time.
_STILL_S: Final = 0.05
#: Pulses that a stalled host cut short are repeated this often.
_TRIES: Final = 4
#: No-load speed of a model whose page was not read for it: faster than those have [rpm].
_UNREAD_RPM: Final = 130.0
_FRICTION: Final = 0.05
_TIME_CONSTANT_S: Final = 0.03
#: Longest pulse; the watchdog ends it one unit after the last instruction, whatever its length.
_LONGEST_S: Final = 0.25


class _Trace(NamedTuple):
    """Time driven [s]; ways [ticks], 1 ms apart; and those while it was driven, timed by the servo."""

    driven_s: float
    positions: tuple[int, ...]
    timed: tuple[TimedCount, ...]


class ServoPulsedBus:
    """Servos that are pulsed one at a time (`contid_devices.pulsed_motors.PulsedBus`)."""

    def __init__(self, client: ServoClient, axes: Sequence[Axis], options: DynamixelBusOptions) -> None:
        self._client = client
        self._axes = {axis.name: axis for axis in axes}
        self._options = options
        self._notes = {axis.name: _left_over(client, axis, options) for axis in axes}
        self._prepared: Axis | None = None
        self._kept: int | None = None
        self._own_pwm = _PWM_FULL

    def device(self, axis: str) -> ProvenDevice:
        """The servo of an axis."""
        return servo_device(self._client, self._axes[axis])

    def notes(self, axis: str) -> Sequence[str]:
        """What other programs left in it, errors, and its supply."""
        volts = self._client.read(self._axes[axis].device, reg.PRESENT_VOLTAGE) / 10.0
        return [*self._notes[axis], f"supply {volts:.1f} V"]

    def counts(self, axis: str) -> int:
        """Its Present Position now [ticks]; moves nothing."""
        return self._client.read(self._axes[axis].device, reg.PRESENT_POSITION)

    def pulse(self, axis: str, duty: float, duration_s: float) -> PulseAnswer:
        """Drive one servo by a Goal PWM, and read what every servo of the bus showed.

        See `contid_devices.pulsed_motors.PulsedBus`; positions are timed by its Realtime Tick.
        """
        servo = self._axes[axis]
        self._prepare(servo)
        most = min(PROBE_PWM, self._own_pwm)
        units = max(-most, min(most, round(duty * _PWM_FULL)))
        for _ in range(_TRIES):
            before = {name: self.counts(name) for name in self._axes}
            if bits := self._client.read(servo.device, reg.HARDWARE_ERROR):
                return self._faulty(servo, units, duration_s, bits)
            try:
                trace = self._drive(servo, units, duration_s)
                bits = self._client.read(servo.device, reg.HARDWARE_ERROR)
            finally:
                search.relax(self._client, [servo])
            if bits:
                return self._faulty(servo, units, duration_s, bits)
            if trace is not None:
                ways = {name: _answer((0, self.counts(name) - at)) for name, at in before.items()}
                ways[axis] = _answer((0, *trace.positions))
                timed = trace.timed if units else ()
                duty, driven_s = units / _PWM_FULL, trace.driven_s
                return PulseAnswer(axis, duty, duration_s, driven_s, ways, trace.positions, timed=timed)
        raise DeviceError(
            self._client.name(servo.device),
            "its watchdog ended every pulse: no answer, or nothing was sent for 20 ms",
            "set the latency timer of the adapter to 1 ms, and look at the load of the host",
        )

    def _faulty(self, servo: Axis, units: int, duration_s: float, bits: int) -> PulseAnswer:
        text = f"hardware error: {reg.describe_hardware_error(bits)}: {reg.remedy_of_hardware_error(bits)}"
        if text not in self._notes[servo.name]:
            self._notes[servo.name].append(text)
        nothing = {name: _answer((0,)) for name in self._axes}
        return PulseAnswer(servo.name, units / _PWM_FULL, duration_s, 0.0, nothing, (), fault=True)

    def _drive(self, servo: Axis, units: int, duration_s: float) -> _Trace | None:
        """One pulse, from torque on; None when the watchdog ended it."""
        client, port, device = self._client, self._client.port, servo.device
        start, stop = (
            sync_write(reg.GOAL_PWM.address, reg.GOAL_PWM.size, [(device, reg.GOAL_PWM.encode(each))])
            for each in (units, 0)
        )
        client.write(device, reg.BUS_WATCHDOG, 0)
        client.write(device, reg.GOAL_PWM, 0)
        if client.read(device, reg.GOAL_PWM) or client.read(device, reg.OPERATING_MODE) != _PWM_MODE:
            raise DeviceError(client.name(device), "it does not take a Goal PWM of 0", "nothing was driven")
        client.write(device, reg.TORQUE_ENABLE, 1)
        first = self._look(servo)
        client.write(device, reg.BUS_WATCHDOG, 1)
        seen, longest_s = [first], _POLL_S
        begin = asked = port.send(start)
        while begin + duration_s - asked > _FREE * longest_s:
            with suppress(NoAnswerError):
                seen.append(self._look(servo, tries=1))
            longest_s = max(longest_s, time.monotonic() - asked)
            asked = time.monotonic()
        time.sleep(max(begin + duration_s - time.monotonic(), 0.0))
        end = port.send(stop)
        driven = seen[1:]
        if client.read(device, reg.BUS_WATCHDOG) == reg.WATCHDOG_TRIPPED:
            return None
        client.write(device, reg.BUS_WATCHDOG, 0)
        moved = time.monotonic()
        while (now := time.monotonic()) < end + _TRACE_S and (not units or now < moved + _STILL_S):
            time.sleep(_POLL_S)
            seen.append(self._look(servo))
            moved = now if seen[-1].counts != seen[-2].counts else moved
        ways = [TimedCount(_since(first, each), each.counts - first.counts) for each in seen]
        grid = range(1, round(ways[-1].time_s * 1000.0) + 1)
        positions = [
            next(way.counts for way in reversed(ways) if way.time_s * 1e3 <= ms + 0.5) for ms in grid
        ]
        return _Trace(end - begin, tuple(positions), tuple(ways[1 : 1 + len(driven)]))

    def _look(self, servo: Axis, tries: int = TRIES) -> TimedCount:
        """Position, and the time of the servo itself."""
        at, last = reg.REALTIME_TICK, reg.PRESENT_POSITION
        size = last.address + last.size - at.address
        block = self._client.read_block(servo.device, at.address, size, tries)
        return TimedCount(at.decode(block[: at.size]) / 1000.0, last.decode(block[-last.size :]))

    def _prepare(self, servo: Axis) -> None:
        """PWM mode with a low limit, torque off; the servo before gets its settings back."""
        if self._prepared is servo:
            return
        self.restore()
        client, device = self._client, servo.device
        self._kept = turns.kept(client, servo)
        self._own_pwm = client.read(device, reg.PWM_LIMIT)
        self._prepared = servo
        for register, value in (
            (reg.PWM_LIMIT, min(PROBE_PWM, self._own_pwm)),
            (reg.DRIVE_MODE, 0),
            (reg.OPERATING_MODE, _PWM_MODE),
            (reg.GOAL_PWM, 0),
        ):
            client.write(device, register, value)

    def restore(self) -> None:
        """Write the settings of the robot file into the servo that was pulsed last, and its own limit."""
        servo, self._prepared = self._prepared, None
        if servo is None:
            return
        client, device = self._client, servo.device
        search.relax(client, [servo])
        client.write(device, reg.PWM_LIMIT, _PWM_FULL if self._own_pwm == PROBE_PWM else self._own_pwm)
        _write_settings(client, servo, self._options)
        if self._kept is not None:
            turns.store(client, servo, self._kept)


@contextmanager
def pulsed_bus(
    name: str, options: DynamixelBusOptions, axes: Sequence[AxisOnBus]
) -> Iterator[ServoPulsedBus]:
    """Open a bus for pulses, every servo without torque; on exit as well, with the file's settings.

    Raises:
        DeviceError: a servo is missing, not that of before, moving, or followed by one beside the robot.
    """
    states = [Axis.of(axis, options) for axis in axes]
    path = find_port(name, options.port)
    with closing(ServoPort(name, path, options.baud, options.usb_latency_ms / 1e3)) as port:
        client = ServoClient(name, port, {axis.device: axis.name for axis in states})
        handshake(client, states, options)
        identity.require_known(client, states, memory_of(name, options.port, path, axes))
        configured = {axis.device for axis in states}
        for each in left_over.followers(client, client.broadcast_ping().keys() - configured, configured):
            raise DeviceError(name, each.message, each.remedy)
        for axis in states:
            if client.read(axis.device, reg.TORQUE_ENABLE) and client.read(axis.device, reg.MOVING):
                raise DeviceError(client.name(axis.device), "it is moving", "stop its robot first")
        if silent := arming.torque_off(client, states):
            raise DeviceError(name, f"torque off is not confirmed by {', '.join(silent)}")
        bus = ServoPulsedBus(client, states, options)
        try:
            yield bus
        finally:
            search.relax(client, states)
            bus.restore()


def _left_over(client: ServoClient, axis: Axis, options: DynamixelBusOptions) -> list[str]:
    """Cure the settings that the robot file states, torque off; name these, and the limits that differ."""
    cured = _write_settings(client, axis, options)
    if client.read(axis.device, reg.PWM_LIMIT) == PROBE_PWM:
        client.write(axis.device, reg.PWM_LIMIT, _PWM_FULL)
        cured.append(f"pwm limit {PROBE_PWM} -> {_PWM_FULL}, of a bring-up that was cut off")
    named = [f"{each.message} -> {each.remedy}" for each in left_over.changed_limits(client, axis.device)]
    return [*([f"left by another program, now as in the file: {', '.join(cured)}"] if cured else []), *named]


def _write_settings(client: ServoClient, axis: Axis, options: DynamixelBusOptions) -> list[str]:
    """Settings of the robot file that differ, as text; they are written. Torque is off."""
    kept = turns.kept(client, axis)
    read_own_limit(client, axis)
    written = []
    for register, value in arming.settings(axis, options):
        if (found := arming.present(client, axis.device, register)) not in (None, value):
            client.write(axis.device, register, value)
            written.append(f"{register.name} {found} -> {value}")
    if kept is not None and turns.kept(client, axis) != kept:
        turns.store(client, axis, kept)
    return written


def _since(first: TimedCount, later: TimedCount) -> float:
    """Time between two readings [s] on the clock of the servo, which begins again after 32.8 s."""
    return (later.time_s - first.time_s) % (reg.REALTIME_TICKS / 1000.0)


def _answer(ways: Sequence[int]) -> EncoderAnswer:
    """The way [ticks] as two tracks would show it; a reading that trembles by a tick shows no edges."""
    span = (max(ways) - min(ways)) // 2
    return EncoderAnswer(ways[-1], span, span, 0)


def drive_facts(axis: DynamixelAxisOptions) -> DriveFacts:
    """What the manual states about the motor of a model, at its nominal supply."""
    top_deg_s = NO_LOAD_RPM.get(axis.model, _UNREAD_RPM) * 6.0
    return DriveFacts(
        reg.TICKS_PER_REV, True, _FRICTION, top_deg_s, _TIME_CONSTANT_S, sealed=True, longest_s=_LONGEST_S
    )
