"""The open port of a bus of servos: handshake, cyclic exchange, and whether it is lost."""

from __future__ import annotations

import copy
import logging
from collections.abc import Sequence
from dataclasses import dataclass

from contid.errors import DeviceError, DeviceLostError, DeviceNotFoundError
from contid.kit.remembered import memory_of
from contid.kit.serial_ports import UsbIdentity, find_port, identity_of
from contid_drivers.dynamixel import duplicates, turns
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis, Turn
from contid_drivers.dynamixel.checks import identity, left_over
from contid_drivers.dynamixel.client import NoAnswerError, ServoClient
from contid_drivers.dynamixel.cycle_time import Slack
from contid_drivers.dynamixel.exchange.answers import AnswerCounts
from contid_drivers.dynamixel.exchange.block import PLAIN, common_layout
from contid_drivers.dynamixel.exchange.cyclic import Cyclic
from contid_drivers.dynamixel.mapping import map_block
from contid_drivers.dynamixel.models import model_name
from contid_drivers.dynamixel.options import DynamixelBusOptions
from contid_drivers.dynamixel.packets import sync_write
from contid_drivers.dynamixel.port import ServoPort

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Opened:
    """An open port.

    Attributes:
        client: single instructions.
        cyclic: one exchange with all servos.
    """

    client: ServoClient
    cyclic: Cyclic


class BusLink:
    """The port of one bus, open, closed or lost.

    Attributes:
        counts: numbers of answers since the bus was made.
        indirect: the cyclic exchange reads mapped bytes.
    """

    def __init__(self, name: str, options: DynamixelBusOptions, axes: Sequence[Axis]) -> None:
        self.name = name
        self.axes = axes
        self.options = options
        self.counts = AnswerCounts()
        self.indirect = False
        self._identity: UsbIdentity | None = None
        self._opened: Opened | None = None
        self._lost: DeviceLostError | None = None
        self._alone = False  # no other servo moves with these

    def open(self) -> None:
        """Connect, and check that the devices of the robot file answer (`contid.hal.Bus.open`)."""
        if self.reachable is not None:
            return
        self.close()
        options = self.options
        path = find_port(self.name, options.port, self._identity)
        port = ServoPort(self.name, path, options.baud, options.usb_latency_ms / 1e3)
        try:
            client = ServoClient(self.name, port, {axis.device: axis.name for axis in self.axes})
            client.watched = self._watched
            handshake(client, self.axes, options)
            memory = memory_of(self.name, options.port, path, self.axes)
            identity.require_known(client, self.axes, memory)
            self._name_left_over(client)
            if memory is not None and not self._alone:
                # A broadcast ping takes 0.8 s: once, and not for emulated servos.
                self._require_no_followers(client)
                self._alone = True
            starts = [map_block(client, axis) for axis in self.axes]
            layout = common_layout(starts)
            for axis in self.axes:
                self._settle(client, axis)
            ids = [axis.device for axis in self.axes]
            cyclic = Cyclic(port, ids, layout, Slack(options.slack_ms), self.counts)
            self.adopt_return_delay(client)
        except BaseException:
            port.close()
            raise
        self._opened, self._lost = Opened(client, cyclic), None
        self.indirect = layout.indirect
        self._identity = identity_of(path) or self._identity
        if layout is PLAIN:
            log.warning("%s: no common indirect addresses; reading %d bytes per servo", self.name, PLAIN.full)
        try:
            cyclic.fast = self.probe_fast()
        except DeviceLostError as error:
            raise self.mark_lost(error) from None

    def _settle(self, client: ServoClient, axis: Axis) -> None:
        """The state of a servo on a port just opened; a rest that was asked for meanwhile stays pending.

        Raises:
            NoAnswerError: it is silent again.
            DeviceLostError: the port is gone again.
        """
        axis.stop_commands()
        axis.misses, axis.turn, asked_for = 0, Turn.UNKNOWN, axis.state
        if axis.watchdog_units and client.read(axis.device, reg.BUS_WATCHDOG) == 0:
            axis.watchdog_units = 0  # it reset while the port was closed, which `turns.settle` sees by itself
        try:
            turns.settle(client, axis)
        except (NoAnswerError, DeviceLostError):
            raise
        except DeviceError as error:
            axis.latch("; ".join(filter(None, (error.message, error.remedy))))
            axis.state = asked_for

    def _name_left_over(self, client: ServoClient) -> None:
        """Log the limits that other programs have changed."""
        for axis in self.axes:
            for each in left_over.changed_limits(client, axis.device):
                log.warning("%s: %s; %s", client.name(axis.device), each.message, each.remedy)

    def _require_no_followers(self, client: ServoClient) -> None:
        """Refuse a bus with a servo that moves with one of the robot's.

        Raises:
            DeviceNotFoundError: one does.
        """
        configured = {axis.device for axis in self.axes}
        others = client.broadcast_ping().keys() - configured
        for each in left_over.followers(client, others, configured):
            raise DeviceNotFoundError(self.name, each.message, each.remedy)

    def close(self) -> None:
        """Close the port. Idempotent; never changes torque (`contid.hal.Bus.close`)."""
        if self._opened is not None:
            self._opened.client.port.close()
        self._opened = self._lost = None

    @property
    def reachable(self) -> Opened | None:
        """The open port; None when it is closed or lost."""
        return self._opened if self._lost is None else None

    def need_open(self) -> Opened:
        """The open port.

        Raises:
            DeviceLostError: it is closed or lost.
        """
        if self._lost is not None:
            raise DeviceLostError(self.name, self._lost.message, self._lost.remedy)
        if self._opened is None:
            raise DeviceLostError(self.name, "the bus is not open")
        return self._opened

    def adopt_return_delay(self, client: ServoClient) -> None:
        """Wait for the slowest servo."""
        client.port.return_delay_s = max(axis.return_delay_s for axis in self.axes)

    def mark_lost(self, error: DeviceLostError) -> DeviceLostError:
        """Keep the error for every call until the next `open`; no axis is enabled any more."""
        self._lost = error
        for axis in self.axes:
            axis.stop_commands()
        return error

    def probe_fast(self) -> bool:
        """True if all servos answer fast reads and the options allow them."""
        if self.options.fast_read == "off":
            return False
        old = [axis for axis in self.axes if axis.firmware < reg.FAST_READ_FIRMWARE]
        if old:
            which = ", ".join(f"id {axis.device} has {axis.firmware}" for axis in old)
            log.warning(
                "%s: Fast Sync Read needs firmware %d, %s; using Sync Read, which is slower",
                self.name, reg.FAST_READ_FIRMWARE, which,
            )  # fmt: skip
            return False
        cyclic = self.need_open().cyclic
        # A servo without fast reads answers none; that is no fault of the wire.
        cyclic.answers.counts = copy.copy(self.counts)
        try:
            for _ in range(3):
                if len(cyclic.run({}, full=True, fast=True)) == len(self.axes):
                    return True
        finally:
            cyclic.answers.counts = self.counts
        log.warning("%s: Fast Sync Read is not answered; using Sync Read, which is slower", self.name)
        return False

    def _watched(self) -> list[int]:
        return [axis.device for axis in self.axes if axis.watchdog_units]


def handshake(client: ServoClient, axes: Sequence[Axis], options: DynamixelBusOptions) -> None:
    """Find every servo; read its firmware and return delay.

    Raises:
        DeviceNotFoundError: a servo is missing or another model; lists expected and found.
    """
    lines, twice = [], False
    for axis in axes:
        model = client.ping(axis.device)
        found = "nothing" if model is None else model_name(model)
        if duplicates.count_answers(client.port, axis.device, duplicates.QUICK_READS).duplicated:
            found, twice = f"broken answers: {duplicates.CAUSE}", True
        if found != axis.options.model:
            lines.append(f"id {axis.device} ({axis.name}): expected {axis.options.model}, found {found}")
    if lines:
        present = ", ".join(
            f"id {device} {model_name(servo.model)} firmware {servo.firmware}"
            for device, servo in sorted(client.broadcast_ping().items())
        )
        raise DeviceNotFoundError(
            client.bus,
            f"at {options.baud} baud: " + "; ".join(lines) + f"; on the bus: {present or 'none'}",
            duplicates.REMEDY if twice else "check power, ids and baud rate with `contid scan`",
        )
    for axis in axes:
        _make_it_answer(client, axis)
        axis.firmware = client.read(axis.device, reg.FIRMWARE)
        axis.return_delay_s = client.read(axis.device, reg.RETURN_DELAY) * 2e-6
        if client.read(axis.device, reg.STATUS_RETURN_LEVEL) != reg.STATUS_RETURN_LEVEL.default:
            client.write(axis.device, reg.STATUS_RETURN_LEVEL, reg.STATUS_RETURN_LEVEL.default)


def _make_it_answer(client: ServoClient, axis: Axis) -> None:
    """Status Return Level (68) := 2 in a servo that answers pings only; such a write has no answer."""
    level, device = reg.STATUS_RETURN_LEVEL, axis.device
    try:
        client.read(device, level)
    except NoAnswerError:
        log.warning("%s: its Status Return Level is 0, it answers pings only; set to 2", client.name(device))
        client.port.flush()
        client.port.send(sync_write(level.address, 1, [(device, level.encode(level.default))]))
        client.port.drain()
