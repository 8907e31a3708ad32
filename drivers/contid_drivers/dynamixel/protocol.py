"""The SDK's packet layer, hardened, and a client for everything that is not the tick.

Replaced in the SDK, each for a measured fault: `txPacket` lost its byte stuffing, so goals such as -131073
arrived as rubbish; `removeStuffing` was not the inverse; `rxPacket` spun and accepted whatever had the right
length. The rest of it is used as it is.
"""

# ruff: noqa: N802 - the names of the SDK methods it overrides

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, Final

from dynamixel_sdk import COMM_PORT_BUSY, COMM_RX_CORRUPT, COMM_RX_TIMEOUT, COMM_SUCCESS
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler

from contid.errors import DeviceError
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.packets import (
    ALERT,
    BROADCAST,
    STATUS_ERROR_TEXT,
    STATUS_OVERHEAD,
    Instruction,
    build,
    take,
)
from contid_drivers.dynamixel.port import BlockingPort
from contid_drivers.dynamixel.registers import Register

#: Tries of one acyclic read or write before the servo counts as silent.
TRIES: Final = 3
#: Model number and firmware in the answer to a ping.
PING_PARAMETERS: Final = 3
#: A servo that reboots answers again within this time.
REBOOT_S: Final = 2.0


class NoAnswerError(DeviceError):
    """A servo did not answer, or only rubbish came."""


class ServoRefusedError(DeviceError):
    """A servo answered and said no."""


class HardenedProtocol(Protocol2PacketHandler):  # type: ignore[misc]  # the SDK has no types
    """`Protocol2PacketHandler` with a right transmit and receive path."""

    def txPacket(self, port: BlockingPort, txpacket: list[int]) -> int:
        """Send what a caller prepared (id, length, instruction, parameters), stuffed and with its CRC."""
        if port.is_using:
            return int(COMM_PORT_BUSY)
        port.is_using = True
        try:
            length = txpacket[5] | txpacket[6] << 8
            body = bytes(txpacket[7 : 5 + length])
            port.flush()
            port.send(build(txpacket[4], body[0], body[1:]))
        except BaseException:
            port.is_using = False
            raise
        return int(COMM_SUCCESS)

    def rxPacket(self, port: BlockingPort, fast_option: bool) -> tuple[list[int], int]:
        """One intact status packet, un-stuffed, in the SDK's layout; others and echoes are skipped."""
        stream = bytearray()
        try:
            while True:
                packet = take(stream)
                if packet is None:
                    data = port.receive(port.deadline)
                    if data:
                        stream += data
                        continue
                    packet = take(stream, final=True)
                    if packet is None:
                        return [], int(COMM_RX_CORRUPT if stream else COMM_RX_TIMEOUT)
                if packet.instruction == Instruction.STATUS:
                    length = len(packet.parameters) + 4
                    head = [*packet.wire[:5], length & 0xFF, length >> 8, packet.instruction, packet.error]
                    return [*head, *packet.parameters, *packet.wire[-2:]], int(COMM_SUCCESS)
        finally:
            port.is_using = False

    def txRxPacket(self, port: BlockingPort, txpacket: list[int]) -> tuple[list[int] | None, int, int]:
        """Send and wait for the answer to just this: from the same servo and of the right length.

        An answer that comes after its time-out, or was meant for a process that is gone, would be taken for
        this one otherwise; the stock SDK reads a model number out of a stale acknowledgement.
        """
        result = self.txPacket(port, txpacket)
        if result != COMM_SUCCESS:
            return None, result, 0
        device, instruction = txpacket[4], txpacket[7]
        if device == BROADCAST:
            port.is_using = False
            return None, int(COMM_SUCCESS), 0
        size = 0
        if instruction == Instruction.READ:
            size = txpacket[10] | txpacket[11] << 8
        elif instruction == Instruction.PING:
            size = PING_PARAMETERS
        port.setPacketTimeout(size + STATUS_OVERHEAD)
        while True:
            answer, result = self.rxPacket(port, False)
            if result != COMM_SUCCESS:
                return None, result, 0
            error = answer[8]
            if answer[4] == device and (len(answer) == size + STATUS_OVERHEAD or error & ~ALERT):
                return answer, result, error


class ServoClient:
    """Reads and writes registers of single servos: handshake, settings, commissioning, homing."""

    def __init__(self, bus: str, port: BlockingPort, names: Mapping[int, str] | None = None) -> None:
        self.bus = bus
        self.port = port
        self._names = names or {}
        self._sdk: Any = HardenedProtocol()

    def name(self, device: int) -> str:
        """How messages call a servo."""
        axis = f" ({self._names[device]})" if device in self._names else ""
        return f"{self.bus}, servo {device}{axis}"

    def ping(self, device: int, tries: int = TRIES) -> int | None:
        """Model number of a servo, None when it is silent."""
        for _ in range(tries):
            model, result, _ = self._sdk.ping(self.port, device)
            if result == COMM_SUCCESS:
                return int(model)
            self.port.drain()
        return None

    def broadcast_ping(self) -> dict[int, tuple[int, int]]:
        """Everybody on the bus: id -> (model number, firmware)."""
        found, _ = self._sdk.broadcastPing(self.port)
        return {int(device): (int(data[0]), int(data[1])) for device, data in found.items()}

    def read_block(self, device: int, address: int, size: int, tries: int = TRIES) -> bytes:
        """Bytes of the control table.

        Raises:
            NoAnswerError: the servo is silent.
            RefusedError: it said no.
        """
        for _ in range(tries):
            data, result, error = self._sdk.readTxRx(self.port, device, address, size)
            if result == COMM_SUCCESS and (error & ~ALERT or len(data) == size):
                self._refused(device, f"reading register {address}", error)
                return bytes(data)
            self.port.drain()
        raise NoAnswerError(self.name(device), f"no answer (reading register {address})", "is it powered?")

    def read(self, device: int, register: Register) -> int:
        """Value of a register; errors as `read_block`."""
        return register.decode(self.read_block(device, register.address, register.size))

    def write(self, device: int, register: Register, value: int) -> None:
        """Set a register; errors as `read_block`."""
        data = list(register.encode(value))
        for _ in range(TRIES):
            result, error = self._sdk.writeTxRx(self.port, device, register.address, register.size, data)
            if result == COMM_SUCCESS:
                self._refused(device, f"writing {value} to {register.name}", error)
                return
            self.port.drain()
        raise NoAnswerError(self.name(device), f"no answer (writing {register.name})", "is it powered?")

    def _refused(self, device: int, what: str, error: int) -> None:
        number = error & ~ALERT
        if number:
            message = STATUS_ERROR_TEXT.get(number, f"error {number}")
            raise ServoRefusedError(self.name(device), f"{what} was refused: {message}")

    def reboot(self, device: int) -> None:
        """Restart a servo and wait until it answers again; its torque is off then, its turn count gone.

        Raises:
            NoAnswerError: it does not come back.
        """
        self._sdk.reboot(self.port, device)
        until = time.monotonic() + REBOOT_S
        while time.monotonic() < until:
            # The answer to the reboot itself may come before it goes deaf.
            time.sleep(0.05)
            if self.ping(device, 1) is not None:
                return
        raise NoAnswerError(self.name(device), f"did not come back within {REBOOT_S:g} s after a reboot")

    def firmware(self, device: int) -> int:
        """Firmware version."""
        return self.read(device, reg.FIRMWARE)
