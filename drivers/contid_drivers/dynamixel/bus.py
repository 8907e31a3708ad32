"""Dynamixel servos on one serial port as a `contid.hal.Bus`."""

from __future__ import annotations

import dataclasses
import logging
import math
import time
from collections.abc import Collection, Mapping, Sequence
from typing import Final

from contid.errors import DeviceError, DeviceLostError
from contid.hal import AxisOnBus, Clock, Rest, Sample
from contid_drivers.dynamixel import arming, readings, torque, turns
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import REST_PENDING, Axis, TorqueState, Turn
from contid_drivers.dynamixel.checks import identity
from contid_drivers.dynamixel.client import ServoClient, ServoError
from contid_drivers.dynamixel.exchange.block import ServoReading
from contid_drivers.dynamixel.exchange.cyclic import Cyclic
from contid_drivers.dynamixel.grip import CurrentShare
from contid_drivers.dynamixel.link import BusLink, Opened
from contid_drivers.dynamixel.options import DynamixelBusOptions

log = logging.getLogger(__name__)

#: Complete exchanges after a miss before fast reads are tried again.
FAST_AGAIN: Final = 200
#: Exchanges in a row that waited on, after which the adapter is the cause and not the host.
STALLS_LOGGED: Final = 20
#: Turns of which a reset is found without mapped bytes, or was found.
_RESET_KNOWN: Final = (Turn.IN_SERVO, Turn.LOST)


class DynamixelBus:
    """One serial port and its Dynamixel servos (`contid.hal.Bus`)."""

    def __init__(
        self, name: str, options: DynamixelBusOptions, axes: Sequence[AxisOnBus], clock: Clock
    ) -> None:
        self.name = name
        self.axes = tuple(axis.name for axis in axes)
        self.options = options
        self._clock = clock
        self._states = {axis.name: Axis.of(axis, options) for axis in axes}
        self._by_id = {axis.device: axis for axis in self._states.values()}
        self._grip = CurrentShare(self._states.values())
        self._link = BusLink(name, options, tuple(self._states.values()))
        #: Axes in whose place another servo was found when they should rest.
        self._strange: set[str] = set()
        self._taken: dict[int, ServoReading] = {}  # usable ones of the newest exchange
        self._doubtful: dict[int, ServoReading] = {}  # of servos that may have reset
        self._count = 0  # exchanges
        self._clean = 0  # complete exchanges since the last miss
        self._late_logged = False
        self._stalls = 0  # in a row

    def open(self) -> None:
        """Connect, and check that the devices of the robot file answer (`contid.hal.Bus.open`)."""
        self._link.open()

    def close(self) -> None:
        """Close the port. Idempotent; never changes torque (`contid.hal.Bus.close`)."""
        self._link.close()

    # -- the tick ------------------------------------------------------------------------------------------

    def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        """Send the commands of a tick, and read every axis (`contid.hal.Bus.exchange`)."""
        opened = self._link.need_open()
        client, cyclic = opened.client, opened.cyclic
        goals = self._goals(commands)
        self._count += 1
        full = self._count % self.options.telemetry_every == 0 or self._count == 1
        faults = [axis.fault for axis in self._states.values()]
        self._taken.clear()
        before_goals = self._grip.packet() if self._grip.axes else b""
        self._doubtful.clear()
        try:
            found = cyclic.run(goals, full, None, before_goals, self._take_answer)
            if len(found) < len(self._by_id):
                self._retry(cyclic, found.keys(), full)
            elif not cyclic.fast and self._clean < FAST_AGAIN and self.options.fast_read != "off":
                self._try_fast_again(cyclic)
            client.fed_s = time.monotonic()
            for device, doubtful in self._doubtful.items():
                self._check_turn(client, device, doubtful)
            now = self._clock.now()
            samples = {}
            for (name, axis), before in zip(self._states.items(), faults, strict=True):
                reading = self._taken.get(axis.device)
                if reading is None:
                    axis.misses += 1
                samples[name] = axis.sample(now, reading is not None)
                if reading is not None and reading.alert and axis.fault == readings.UNREAD_ALERT:
                    samples[name] = self._find_cause(client, axis, reading, now, samples[name])
                if axis.fault != before:
                    log.error("%s: %s", axis.name, axis.fault)
                if axis.state in REST_PENDING and reading is not None:
                    self._rest(client, axis, reading)
            self._note_missing(opened)
        except DeviceLostError as error:
            raise self._link.mark_lost(error) from None
        return samples

    def _take_answer(self, device: int, reading: ServoReading) -> None:
        """Take a reading, unless it may come from a servo that has reset itself.

        On a bus with mapped bytes, one without them proves nothing of a servo that keeps no turn and has no
        watchdog: it is dropped.
        """
        axis, now = self._by_id[device], self._clock.now()
        shows_reset = reading.voltage_low is not None or axis.watchdog_units or axis.turn in _RESET_KNOWN
        angle = axis.to_rad(reading.position)
        if readings.may_be_after_reset(axis, reading, angle, now):
            self._doubtful[device] = reading
        elif shows_reset or not self._link.indirect:
            readings.take(axis, reading, angle, now)
            self._taken[device] = reading

    def _check_turn(self, client: ServoClient, device: int, reading: ServoReading) -> None:
        """Take a doubtful reading if the servo keeps the mark of its turn; in a tick, so with one try."""
        axis = self._by_id[device]
        try:
            if turns.has_reset(client, axis):
                axis.latch_reset()
        except ServoError:
            return
        readings.take(axis, reading, axis.to_rad(reading.position), self._clock.now())
        self._taken[device] = reading

    def _note_missing(self, opened: Opened) -> None:
        """Read servos that missed several exchanges last, discard late answers, log the first late one."""
        cyclic = opened.cyclic
        self._stalls = self._stalls + 1 if cyclic.answers.stalled else 0
        if self._stalls >= STALLS_LOGGED and not self._late_logged:
            self._log_late(cyclic, "and every exchange waits for them")
        missing = [axis for axis in self._states.values() if axis.misses]
        if missing or cyclic.silent:
            opened.client.expect_late(axis.device for axis in missing)
            cyclic.put_last([axis.device for axis in missing if axis.dead])
        if cyclic.answers.counts.late and not self._late_logged:
            self._log_late(cyclic, "and are discarded")

    def _log_late(self, cyclic: Cyclic, then: str) -> None:
        """Log that the adapter is late; once in a run."""
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
            if axis.state is TorqueState.ENABLED and not axis.misses:
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
        if not cyclic.answers.received and not cyclic.received_before:
            return
        until = time.monotonic() + self.options.retry_ms / 1e3
        if fast:
            log.debug("%s: fast read broke off; plain reads for %d exchanges", self.name, FAST_AGAIN)
            until += cyclic.timeout_s(full)
        cyclic.read_again(missing, full, until, self._take_answer)

    def _try_fast_again(self, cyclic: Cyclic) -> None:
        """After complete exchanges in a row by plain reads."""
        self._clean += 1
        if self._clean == FAST_AGAIN:
            cyclic.fast = self._link.probe_fast()

    def _find_cause(
        self, client: ServoClient, axis: Axis, reading: ServoReading, now: float, sample: Sample
    ) -> Sample:
        """Read the cause of an alert, which the block lacks; where that fails, the next exchange does."""
        cause = reg.HARDWARE_ERROR
        try:
            axis.hardware_error = cause.decode(client.look(axis.device, cause.address, cause.size))
        except ServoError:
            return sample
        readings.detect_reported(axis, reading)
        return axis.sample(now, True)

    def _rest(self, client: ServoClient, axis: Axis, reading: ServoReading) -> None:
        """Bring a faulty servo to rest, now that it answers; not the servo of another robot."""
        try:
            if not identity.is_same(client, axis):
                if axis.name not in self._strange:
                    self._strange.add(axis.name)
                    message = "another servo answers in its place; it gets no rest and may have torque"
                    log.error("%s: %s", axis.name, message)
                return
            arming.rest(client, axis, None if axis.turn is Turn.LOST else reading.position)
        except ServoError as error:
            log.debug("%s: not brought to rest yet: %s", axis.name, error)

    def answer_counts(self) -> Mapping[str, int]:
        """Counts since the bus was built, by what is counted: ``exchanges``, ``late``, ``silent``."""
        return dataclasses.asdict(self._link.counts)

    # -- effort --------------------------------------------------------------------------------------------

    def effort_limits(self) -> Mapping[str, float]:
        """Greatest effort [A] of every axis that can be limited, by the robot file."""
        return self._grip.limits()

    def limit_effort(self, shares: Mapping[str, float]) -> None:
        """Limit axes to a share (0 to 1) of their greatest effort, from the next exchange on."""
        self._named(list(shares))
        self._grip.change(shares)

    # -- torque --------------------------------------------------------------------------------------------

    def enable(self, axes: Sequence[str]) -> None:
        """Make axes ready to move without moving them: goal := present, torque on, watchdog armed."""
        torque.enable(self._link, self._named(axes))

    def disable(self, axes: Sequence[str], rest: Rest) -> None:
        """See `contid.hal.Bus.disable`; servos cannot vent, so ``vent`` relaxes them."""
        torque.disable(self._link, self._named(axes), rest)

    def clear_fault(self, axes: Sequence[str]) -> None:
        """Clear latched device faults without motion; raises `DeviceError` if one persists."""
        torque.clear_fault(self._link, self._named(axes))

    def _named(self, axes: Sequence[str]) -> list[Axis]:
        unknown = [name for name in axes if name not in self._states]
        if unknown:
            raise DeviceError(self.name, f"no axis {unknown[0]!r}; axes: {', '.join(self.axes)}")
        return [self._states[name] for name in axes]
