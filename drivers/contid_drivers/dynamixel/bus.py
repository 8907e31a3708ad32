"""Dynamixel servos on one serial port as a `contid.hal.Bus`."""

from __future__ import annotations

import copy
import dataclasses
import logging
import math
import time
from collections.abc import Collection, Mapping, Sequence
from typing import Final

from contid.errors import DeviceError, DeviceLostError
from contid.hal import AxisOnBus, Clock, Rest, Sample
from contid_drivers.dynamixel import arming, turns
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.client import NoAnswerError, ServoClient
from contid_drivers.dynamixel.exchange.answers import AnswerCounts
from contid_drivers.dynamixel.exchange.block import PLAIN, CyclicLayout, ServoReading, common_layout
from contid_drivers.dynamixel.exchange.cyclic import Cyclic
from contid_drivers.dynamixel.exchange.slack import Slack
from contid_drivers.dynamixel.grip import CurrentShare
from contid_drivers.dynamixel.mapping import map_block
from contid_drivers.dynamixel.options import DynamixelBusOptions
from contid_drivers.dynamixel.port import ServoPort
from contid_drivers.serial_ports import UsbIdentity, find_port, identity_of

log = logging.getLogger(__name__)

#: Complete exchanges after a miss before fast reads are tried again.
FAST_AGAIN: Final = 200
#: Exchanges in a row that waited on, after which the adapter is the cause and not the host.
STALLS_LOGGED: Final = 20


class DynamixelBus:
    """See `contid.hal.Bus`: one serial port and its servos."""

    def __init__(
        self,
        name: str,
        options: DynamixelBusOptions,
        axes: Sequence[AxisOnBus],
        clock: Clock,
        layout: CyclicLayout | None = None,
    ) -> None:
        self.name = name
        self.axes = tuple(axis.name for axis in axes)
        self.options = options
        self._clock = clock
        self._states = {axis.name: Axis.of(axis, options) for axis in axes}
        self._by_id = {axis.device: axis for axis in self._states.values()}
        self._layout = layout
        self._grip = CurrentShare(self._states.values())
        self._identity: UsbIdentity | None = None
        self._port: ServoPort | None = None
        self._client: ServoClient | None = None
        self._cyclic: Cyclic | None = None
        self._lost: DeviceLostError | None = None
        self._counts = AnswerCounts()
        self._indirect = False
        self._readings: dict[int, ServoReading] = {}  # usable ones of the newest exchange
        self._count = 0  # exchanges
        self._clean = 0  # complete exchanges since the last miss
        self._late_logged = False
        self._stalls = 0  # in a row

    # -- port ----------------------------------------------------------------------------------------------

    def open(self) -> None:
        """See `contid.hal.Bus.open`."""
        if self._cyclic is not None and self._lost is None:
            return
        self.close()
        options = self.options
        path = find_port(self.name, options.port, self._identity)
        port = ServoPort(self.name, path, options.baud, options.usb_latency_ms / 1e3)
        port.open()
        try:
            client = ServoClient(self.name, port, {axis.device: name for name, axis in self._states.items()})
            states = tuple(self._states.values())
            client.armed = self._armed
            arming.handshake(client, states, options)
            starts = [map_block(client, axis) for axis in states]
            layout = self._layout or common_layout(starts)
            for axis in states:
                axis.enabled, axis.misses, axis.reset, axis.pending_rest = False, 0, False, None
                try:
                    turns.settle(client, axis)
                except NoAnswerError:
                    raise
                except DeviceError as error:
                    axis.latch(f"{error.message}; {error.remedy}")
                    axis.pending_rest = None
            port.return_delay_s = max(axis.return_delay_s for axis in states)
            slack = Slack.of(options.slack_ms)
            self._cyclic = Cyclic(port, [axis.device for axis in states], layout, False, slack, self._counts)
        except BaseException:
            port.close()
            raise
        self._port, self._client, self._lost = port, client, None
        self._indirect = layout.indirect
        self._identity = identity_of(path) or self._identity
        if layout is PLAIN:
            log.warning("%s: no common indirect addresses; reading %d bytes per servo", self.name, PLAIN.full)
        self._cyclic.fast = self._probe_fast()

    def _armed(self) -> list[int]:
        return [axis.device for axis in self._states.values() if axis.armed]

    def _probe_fast(self) -> bool:
        if self.options.fast_read == "off":
            return False
        old = [axis for axis in self._states.values() if axis.firmware < reg.FAST_READ_FIRMWARE]
        if old:
            which = ", ".join(f"id {axis.device} has {axis.firmware}" for axis in old)
            log.warning(
                "%s: Fast Sync Read needs firmware %d, %s; using Sync Read, which is slower",
                self.name, reg.FAST_READ_FIRMWARE, which,
            )  # fmt: skip
            return False
        cyclic = self._cyclic
        assert cyclic is not None
        # A servo without fast reads answers none; that is no fault of the wire.
        cyclic.counts = copy.copy(self._counts)
        try:
            for _ in range(3):
                if len(cyclic.run({}, full=True, fast=True)) == len(self._by_id):
                    return True
        finally:
            cyclic.counts = self._counts
        log.warning("%s: Fast Sync Read is not answered; using Sync Read, which is slower", self.name)
        return False

    def close(self) -> None:
        """See `contid.hal.Bus.close`."""
        if self._port is not None:
            self._port.close()
        self._port = self._client = self._cyclic = self._lost = None

    # -- the tick ------------------------------------------------------------------------------------------

    def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        """See `contid.hal.Bus.exchange`."""
        cyclic = self._opened()
        assert self._client is not None
        goals = self._goals(commands)
        self._count += 1
        full = self._count % self.options.telemetry_every == 0 or self._count == 1
        faults = [axis.fault for axis in self._states.values()]
        self._readings.clear()
        try:
            found = cyclic.run(goals, full, None, self._grip.packet(), self._answered)
            if len(found) < len(self._by_id):
                self._retry(cyclic, found.keys(), full)
            else:
                self._count_complete(cyclic)
            self._client.fed_s = time.monotonic()
            now = self._clock.now()
            samples = {}
            for (name, axis), before in zip(self._states.items(), faults, strict=True):
                reading = self._readings.get(axis.device)
                samples[name] = axis.missed(now) if reading is None else axis.sample(now)
                if axis.fault != before:
                    samples[name] = self._find_cause(axis, reading, now, samples[name])
                if axis.pending_rest is not None and reading is not None:
                    self._rest(axis, reading)
            self._note_missing(cyclic)
        except DeviceLostError as error:
            raise self._mark_lost(error) from None
        return samples

    def _answered(self, device: int, reading: ServoReading) -> None:
        """Take a reading, unless it may come from a servo that has reset itself.

        Without mapped bytes only an armed watchdog excludes a reset.
        """
        axis = self._by_id[device]
        if axis.armed or reading.voltage_low is not None or not self._indirect:
            axis.take(reading, self._clock.now())
            self._readings[device] = reading

    def _note_missing(self, cyclic: Cyclic) -> None:
        """Read servos that missed several exchanges last, discard late answers, log the first late one."""
        assert self._client is not None
        self._stalls = self._stalls + 1 if cyclic.stalled else 0
        if self._stalls >= STALLS_LOGGED:
            self._log_late(cyclic, "and every exchange waits for them")
        missing = [axis for axis in self._states.values() if axis.misses]
        if not missing and not cyclic.disturbed:
            return
        self._client.expect_late(axis.device for axis in missing)
        cyclic.put_last([axis.device for axis in missing if axis.misses > 1])
        if cyclic.counts.late:
            self._log_late(cyclic, "and are discarded")

    def _log_late(self, cyclic: Cyclic, then: str) -> None:
        """Log once that the adapter is late."""
        if self._late_logged:
            return
        self._late_logged = True
        log.warning(
            "%s: answers come after their time-out of %.1f ms %s; set the adapter's "
            "latency timer to 1 ms or raise usb_latency_ms (`contid doctor`)",
            self.name, 1e3 * cyclic.timeout_s(), then,
        )  # fmt: skip

    def _goals(self, commands: Mapping[str, float]) -> dict[int, int]:
        """Commands of the enabled axes in ticks by id; one invalid command refuses all."""
        goals: dict[int, int] = {}
        for name, angle in commands.items():
            axis = self._states.get(name) or self._named([name])[0]
            if not math.isfinite(angle):
                raise DeviceError(self.name, f"{name}: command {angle} is not finite")
            goal = axis.to_ticks(angle)
            if not reg.GOAL_POSITION.low <= goal <= reg.GOAL_POSITION.high:
                raise DeviceError(self.name, f"{name}: {angle:g} rad is beyond the 256 turns of a servo")
            # A servo that missed an exchange may have reset itself: its turn is checked first.
            if axis.enabled and not axis.misses:
                axis.goal = angle
                goals[axis.device] = goal
        return goals

    def _retry(self, cyclic: Cyclic, found: Collection[int], full: bool) -> None:
        """Ask the servos that did not answer once more, in one read, within ``retry_ms``.

        A servo that was silent in the last exchange as well is skipped: it would cost the budget in every
        tick. During a stall of the host nothing is repeated. A fast read that broke off hides all servos
        after the break: they are asked by a plain read, and the next exchanges use plain reads.
        """
        fast, cyclic.fast, self._clean = cyclic.fast, False, 0
        missing = [
            device
            for device, axis in self._by_id.items()
            if device not in found and (fast or not axis.misses or device in cyclic.returned)
        ]
        if not missing or not self.options.retry_ms:
            return
        if not cyclic.received and not cyclic.received_before:
            return
        until = time.monotonic() + self.options.retry_ms / 1e3
        if fast:
            log.debug("%s: fast read broke off; plain reads for %d exchanges", self.name, FAST_AGAIN)
            until += cyclic.timeout_s(full)
        cyclic.again(missing, full, until, self._answered)

    def _count_complete(self, cyclic: Cyclic) -> None:
        if cyclic.fast or self.options.fast_read == "off":
            return
        self._clean += 1
        if self._clean == FAST_AGAIN:
            cyclic.fast = self._probe_fast()

    def _find_cause(self, axis: Axis, reading: ServoReading | None, now: float, sample: Sample) -> Sample:
        """Read the cause of a new fault if the block did not hold it, and log it once."""
        if reading is not None and reading.alert and not axis.hardware_error and self._client is not None:
            try:
                axis.hardware_error = self._client.read(axis.device, reg.HARDWARE_ERROR)
                axis.fault = ""
                axis.take(reading, now)
                sample = axis.sample(now)
            except NoAnswerError:
                pass
        log.error("%s: %s", axis.name, axis.fault)
        return sample

    def _rest(self, axis: Axis, reading: ServoReading) -> None:
        """Bring a faulty servo to rest, now that it answers."""
        assert self._client is not None
        try:
            arming.rest(self._client, axis, None if axis.reset else reading.position)
        except NoAnswerError:
            log.debug("%s: silent again before it was brought to rest", axis.name)

    def _opened(self) -> Cyclic:
        if self._lost is not None:
            raise DeviceLostError(self.name, self._lost.message, self._lost.remedy)
        if self._cyclic is None:
            raise DeviceLostError(self.name, "the bus is not open")
        return self._cyclic

    def _mark_lost(self, error: DeviceLostError) -> DeviceLostError:
        self._lost = error
        for axis in self._states.values():
            axis.enabled = False
        return error

    def answer_counts(self) -> Mapping[str, int]:
        """See `contid.hal.CountsAnswers`."""
        return dataclasses.asdict(self._counts)

    # -- effort --------------------------------------------------------------------------------------------

    def effort_limits(self) -> Mapping[str, float]:
        """See `contid.hal.LimitsEffort`."""
        return self._grip.limits()

    def limit_effort(self, shares: Mapping[str, float]) -> None:
        """See `contid.hal.LimitsEffort`."""
        self._named(list(shares))
        self._grip.change(shares)

    # -- torque --------------------------------------------------------------------------------------------

    def enable(self, axes: Sequence[str]) -> None:
        """See `contid.hal.Bus.enable`."""
        self._opened()
        client = self._client
        assert client is not None
        chosen = [axis for axis in self._named(axes) if not axis.enabled]
        for axis in chosen:
            if axis.fault:
                raise DeviceError(self.name, f"{axis.name}: {axis.fault}", "clear the fault first")
        started: list[Axis] = []
        try:
            for axis in chosen:
                arming.configure(client, axis, self.options)
            assert self._port is not None
            self._port.return_delay_s = max(axis.return_delay_s for axis in self._states.values())
            for axis in chosen:
                if not client.read(axis.device, reg.TORQUE_ENABLE):
                    started.append(axis)
                arming.arm(client, axis)
            if chosen:
                self._start_watchdogs(client, chosen)
        except DeviceLostError as error:
            raise self._mark_lost(error) from None
        except DeviceError:
            self._back_out(chosen, started)
            raise

    def _start_watchdogs(self, client: ServoClient, chosen: Sequence[Axis]) -> None:
        """Watchdogs on, read back in one exchange, which also feeds all of them."""
        arming.start_watchdogs(client, chosen, self.options.watchdog_ms // reg.WATCHDOG_MS_PER_UNIT)
        readings = self._opened().run({}, full=True)
        for axis in chosen:
            reading = readings.get(axis.device)
            found = None if reading is None else reading.watchdog
            if found is None:
                found = client.read(axis.device, reg.BUS_WATCHDOG)
            if found != axis.armed:
                raise DeviceError(client.name(axis.device), f"its Bus Watchdog does not come on: {found}")

    def _back_out(self, chosen: Sequence[Axis], started: Sequence[Axis]) -> None:
        """Undo a failed `enable`: torque it switched on goes off, axes held before stay held."""
        assert self._client is not None
        if started:
            arming.torque_off(self._client, started)
        for axis in chosen:
            axis.enabled = False
            if axis.armed and axis not in started:
                arming.hold_position(self._client, axis)

    def disable(self, axes: Sequence[str], rest: Rest) -> None:
        """See `contid.hal.Bus.disable`; servos cannot vent, so ``vent`` relaxes them."""
        named = self._named(axes)
        client = self._client
        if client is None or self._lost is not None:
            return
        try:
            if rest is not Rest.HOLD:
                silent = arming.torque_off(client, named)
                for axis in named:
                    axis.pending_rest = Rest.RELAX if axis.name in silent else None
                if silent:
                    log.error("%s: torque off not confirmed by %s", self.name, ", ".join(silent))
                return
            for axis in named:
                axis.enabled, axis.pending_rest = False, Rest.HOLD
                try:
                    arming.hold_position(client, axis)
                    axis.pending_rest = None
                except DeviceLostError:
                    raise
                except DeviceError as error:
                    # Its watchdog stays armed and will hold it where it is.
                    log.error("%s", error)
        except DeviceLostError as error:
            self._mark_lost(error)
        except DeviceError as error:
            log.error("%s", error)

    def clear_fault(self, axes: Sequence[str]) -> None:
        """See `contid.hal.Bus.clear_fault`."""
        self._opened()
        assert self._client is not None
        try:
            for axis in self._named(axes):
                if axis.fault or not axis.enabled:
                    arming.recover(self._client, axis)
        except DeviceLostError as error:
            raise self._mark_lost(error) from None

    def _named(self, axes: Sequence[str]) -> list[Axis]:
        unknown = [name for name in axes if name not in self._states]
        if unknown:
            raise DeviceError(self.name, f"no axis {unknown[0]!r}; axes: {', '.join(self.axes)}")
        return [self._states[name] for name in axes]
