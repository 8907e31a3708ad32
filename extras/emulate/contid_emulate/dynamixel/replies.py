"""Answers of the servos of a bus to an instruction packet, and their times, without a port.

Times count from the end of the instruction on the wire. Servos answer a sync or bulk read in the order of
their ids in it; a missing one costs the next one a slot. Two servos with one id answer at the same time: the
AND of their levels arrives.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.packets import (
    BROADCAST,
    HEADER,
    Instruction,
    Packet,
    StatusError,
    build_status,
    crc16,
)
from contid_emulate.dynamixel.servo import Servo

#: Wait of the next servo of a sync read for a silent one (assumed; not in the manual).
SLOT_S: Final = 100e-6
_FAST: Final = (Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ)
_GROUP_READS: Final = (Instruction.SYNC_READ, Instruction.BULK_READ, *_FAST)
_GROUP_WRITES: Final = (Instruction.SYNC_WRITE, Instruction.BULK_WRITE)
_READS: Final = (Instruction.PING, Instruction.READ)


@dataclass(frozen=True, slots=True)
class StatusReply:
    """Bytes on the wire and the time of their last byte, after the end of the instruction [s].

    ``ends`` are where parts of several servos end, in an answer that they send together.
    """

    device: int
    wire: bytes
    at_s: float
    ends: tuple[int, ...] = ()


class BlockAccess(NamedTuple):
    """Registers of one servo that a sync or bulk packet reads or writes."""

    device: int
    start: int
    size: int
    data: bytes = b""


def answers(packet: Packet, servos: Sequence[Servo], byte_s: float) -> list[StatusReply]:
    """Let servos execute an instruction and return their answers.

    Args:
        packet: the instruction.
        servos: those that receive it (same baud rate, powered, not silent).
        byte_s: time of one byte on the wire.
    """
    instruction = packet.instruction
    if instruction in _GROUP_READS:
        return _reads(instruction, _blocks(packet), servos, byte_s)
    if instruction in _GROUP_WRITES:
        for block in _blocks(packet):
            for servo in servos:
                if servo.device == block.device:
                    servo.write(block.start, block.data)
        return []
    at_s = 0.0
    found: list[StatusReply] = []
    for servo in sorted(servos, key=lambda each: each.device):
        if packet.device not in (servo.device, BROADCAST):
            continue
        device, delay_s, level = servo.device, servo.return_delay_s, servo.get(reg.STATUS_RETURN_LEVEL)
        error, data = _act(packet, servo)
        broadcast = packet.device == BROADCAST
        if broadcast and instruction != Instruction.PING:
            continue
        if level == 2 or instruction == Instruction.PING or (level == 1 and instruction in _READS):
            wire = build_status(device, error | servo.alert, data)
            if found and found[-1].device == device:
                found[-1] = StatusReply(device, _collide(found[-1].wire, wire), found[-1].at_s)
                continue
            at_s += delay_s + len(wire) * byte_s
            found.append(StatusReply(device, wire, at_s))
    return found


def misreadings(packet: Packet, servos: Sequence[Servo], byte_s: float) -> list[StatusReply]:
    """Answers of servos that an instruction to one of them reached damaged; they do nothing."""
    found = []
    for servo in servos:
        if servo.device == packet.device and servo.get(reg.STATUS_RETURN_LEVEL) == 2:
            wire = build_status(servo.device, StatusError.CRC | servo.alert)
            found.append(StatusReply(servo.device, wire, servo.return_delay_s + len(wire) * byte_s))
    return found


def addressed(packet: Packet) -> Container[int]:
    """Ids that an instruction is for: its own, those named in a sync or bulk packet, or all."""
    if packet.device != BROADCAST:
        return (packet.device,)
    if packet.instruction in _GROUP_READS or packet.instruction in _GROUP_WRITES:
        return {block.device for block in _blocks(packet)}
    return range(BROADCAST)


def _blocks(packet: Packet) -> list[BlockAccess]:
    """What a sync or bulk packet reads or writes."""
    p, first = packet.parameters, _word(packet.parameters, 0)
    if packet.instruction in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
        return [BlockAccess(device, first, _word(p, 2)) for device in p[4:]]
    if packet.instruction in (Instruction.BULK_READ, Instruction.FAST_BULK_READ):
        return [BlockAccess(p[i], _word(p, i + 1), _word(p, i + 3)) for i in range(0, len(p) - 4, 5)]
    if packet.instruction == Instruction.SYNC_WRITE:
        size = _word(p, 2)
        starts = range(4, len(p) - size, size + 1)
        return [BlockAccess(p[i], first, size, p[i + 1 : i + 1 + size]) for i in starts]
    blocks, at = [], 0
    while at + 5 <= len(p):
        size = _word(p, at + 3)
        blocks.append(BlockAccess(p[at], _word(p, at + 1), size, p[at + 5 : at + 5 + size]))
        at += 5 + size
    return blocks


def _act(packet: Packet, servo: Servo) -> tuple[int, bytes]:
    p = packet.parameters
    match packet.instruction:
        case Instruction.PING:
            return 0, servo.read(0, 2) + servo.read(reg.FIRMWARE.address, 1)
        case Instruction.READ if len(p) == 4:
            return 0, servo.read(_word(p, 0), _word(p, 2))
        case Instruction.WRITE if len(p) > 2:
            return servo.write(_word(p, 0), p[2:]), b""
        case Instruction.REG_WRITE if len(p) > 2:
            return servo.register_write(_word(p, 0), p[2:]), b""
        case Instruction.ACTION:
            return servo.action(), b""
        case Instruction.FACTORY_RESET if len(p) == 1:
            # From firmware 42 on a broadcast does not reset everything.
            refused = packet.device == BROADCAST and p[0] == 0xFF
            return StatusError.NONE if refused else servo.factory_reset(p[0]), b""
        case Instruction.REBOOT:
            servo.reboot()
            return 0, b""
        case Instruction.CLEAR:
            return servo.clear(p), b""
    return StatusError.INSTRUCTION, b""


def _reads(
    instruction: int, blocks: list[BlockAccess], servos: Sequence[Servo], byte_s: float
) -> list[StatusReply]:
    by_id: dict[int, list[Servo]] = {}
    for servo in servos:
        by_id.setdefault(servo.device, []).append(servo)
    if instruction in _FAST:
        return _fast(blocks, by_id, byte_s)
    at_s = 0.0
    found: list[StatusReply] = []
    for device, start, size, _ in blocks:
        talking = [s for s in by_id.get(device, ()) if s.get(reg.STATUS_RETURN_LEVEL) > 0]
        if not talking:
            at_s += SLOT_S
            continue
        wires = [build_status(device, servo.alert, servo.read(start, size)) for servo in talking]
        wire = wires[0]
        for other in wires[1:]:
            wire = _collide(wire, other)
        at_s += talking[0].return_delay_s + len(wire) * byte_s
        found.append(StatusReply(device, wire, at_s))
    return found


def _fast(blocks: list[BlockAccess], by_id: dict[int, list[Servo]], byte_s: float) -> list[StatusReply]:
    """One packet; a missing servo ends it, because the next one waits for its bytes."""
    length = 3 + sum(block.size + 4 for block in blocks) - 2
    wire = bytearray(HEADER + bytes((BROADCAST, length & 0xFF, length >> 8, Instruction.STATUS)))
    at_s = 0.0
    ends: list[int] = []
    for i, (device, start, size, _) in enumerate(blocks):
        servo = next(iter(by_id.get(device, ())), None)
        if servo is None or servo.get(reg.FIRMWARE) < reg.FAST_READ_FIRMWARE:
            if i == 0:
                return []
            break
        if i == 0:
            at_s = servo.return_delay_s
        wire += bytes((servo.alert, device)) + servo.read(start, size)
        wire += crc16(wire).to_bytes(2, "little")
        ends.append(len(wire))
    return [StatusReply(BROADCAST, bytes(wire), at_s + len(wire) * byte_s, tuple(ends))] if blocks else []


def _word(data: bytes, at: int) -> int:
    return data[at] | data[at + 1] << 8 if len(data) >= at + 2 else 0


def _collide(one: bytes, other: bytes) -> bytes:
    return bytes(a & b for a, b in zip(one, other, strict=False))
