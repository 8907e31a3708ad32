"""Protocol 2.0: the examples of its documentation, stuffing as a bijection, and taking packets from noise."""

from __future__ import annotations

import random

import dynamixel_sdk as sdk
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid_drivers.dynamixel import packets
from contid_drivers.dynamixel.exchange.fast_answer import FastAnswer
from contid_drivers.dynamixel.packets import (
    Instruction,
    build,
    build_status,
    crc16,
    stuff,
    take,
    unstuff,
)

# e-manual, Protocol 2.0, "Instruction Details": (what, packet built here, bytes printed there).
EXAMPLES = [
    ("ping", build(1, Instruction.PING), "FF FF FD 00 01 03 00 01 19 4E"),
    ("ping status 1", build_status(1, 0, b"\x06\x04\x26"), "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D"),
    ("broadcast ping", build(254, Instruction.PING), "FF FF FD 00 FE 03 00 01 31 42"),
    ("ping status 2", build_status(2, 0, b"\x06\x04\x26"), "FF FF FD 00 02 07 00 55 00 06 04 26 6F 6D"),
    (
        "read",
        build(1, Instruction.READ, packets.read_parameters(132, 4)),
        "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15",
    ),
    ("read status", build_status(1, 0, b"\xa6\0\0\0"), "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0"),
    (
        "write",
        build(1, Instruction.WRITE, b"\x74\0\0\x02\0\0"),
        "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89",
    ),
    ("write status", build_status(1, 0), "FF FF FD 00 01 04 00 55 00 A1 0C"),
    (
        "reg write",
        build(1, Instruction.REG_WRITE, b"\x68\0\xc8\0\0\0"),
        "FF FF FD 00 01 09 00 04 68 00 C8 00 00 00 AE 8E",
    ),
    ("action", build(1, Instruction.ACTION), "FF FF FD 00 01 03 00 05 02 CE"),
    ("factory reset", build(1, Instruction.FACTORY_RESET, b"\x01"), "FF FF FD 00 01 04 00 06 01 A1 E6"),
    ("reboot", build(1, Instruction.REBOOT), "FF FF FD 00 01 03 00 08 2F 4E"),
    (
        "clear",
        build(1, Instruction.CLEAR, b"\x01\x44\x58\x4c\x22"),
        "FF FF FD 00 01 08 00 10 01 44 58 4C 22 B1 DC",
    ),
    ("sync read", packets.sync_read(132, 4, [1, 2]), "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA"),
    (
        "sync read status 2",
        build_status(2, 0, b"\x1f\x08\0\0"),
        "FF FF FD 00 02 08 00 55 00 1F 08 00 00 BA BE",
    ),
    (
        "sync write",
        packets.sync_write(116, 4, [(1, b"\x96\0\0\0"), (2, b"\xaa\0\0\0")]),
        "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
    ),
    (
        "bulk read",
        build(254, Instruction.BULK_READ, b"\x01\x90\0\x02\0\x02\x92\0\x01\0"),
        "FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05",
    ),
    (
        "bulk write",
        build(254, Instruction.BULK_WRITE, b"\x01\x20\0\x02\0\xa0\0\x02\x1f\0\x01\0\x50"),
        "FF FF FD 00 FE 10 00 93 01 20 00 02 00 A0 00 02 1F 00 01 00 50 B7 68",
    ),
]

# Payloads made of the bytes stuffing is about.
nasty = st.lists(st.sampled_from([0xFF, 0xFD, 0x00, 0x55]), max_size=24).map(bytes)


@pytest.mark.parametrize(("built", "printed"), [e[1:] for e in EXAMPLES], ids=[e[0] for e in EXAMPLES])
def test_examples_of_the_documentation(built: bytes, printed: str) -> None:
    assert built == bytes.fromhex(printed)


def test_a_hundred_thousand_payloads_survive_stuffing_and_never_look_like_a_header() -> None:
    dice = random.Random(3)
    for _ in range(100_000):
        payload = bytes(dice.choices((0xFF, 0xFF, 0xFD, 0xFD, 0x00, 0x17), k=dice.randrange(1, 24)))
        wire = stuff(payload)
        assert unstuff(wire) == payload
        assert wire.count(b"\xff\xff\xfd") == wire.count(b"\xff\xff\xfd\xfd")


@given(nasty)
def test_what_is_built_is_taken_back(payload: bytes) -> None:
    stream = bytearray(build_status(3, 0x80, payload))
    packet = take(stream)
    assert packet is not None
    assert (packet.device, packet.error, packet.parameters, bytes(stream)) == (3, 0x80, payload, b"")


@given(nasty, nasty)
def test_a_packet_is_found_behind_rubbish_and_a_broken_one(rubbish: bytes, payload: bytes) -> None:
    broken = bytearray(build_status(1, 0, b"1234"))
    broken[-1] ^= 1
    stream = bytearray(rubbish + broken + build_status(2, 0, payload))
    packet = take(stream, final=True)
    assert packet is not None
    assert (packet.device, packet.parameters) == (2, payload)


@given(nasty, st.integers(1, 12))
def test_bytes_may_come_in_any_pieces(payload: bytes, piece: int) -> None:
    wire = build_status(7, 0, payload)
    stream, found = bytearray(), []
    for i in range(0, len(wire), piece):
        stream += wire[i : i + piece]
        if (packet := take(stream)) is not None:
            found.append(packet.parameters)
    assert found == [payload]


def test_a_corrupted_length_does_not_swallow_the_next_packet() -> None:
    broken = bytearray(build_status(1, 0, b"1234"))
    broken[5] = 200
    stream = bytearray(bytes(broken) + build_status(2, 0, b"ok"))
    assert take(stream) is None
    packet = take(stream, final=True)
    assert packet is not None
    assert packet.device == 2


def fast_answer(parts: list[tuple[int, bytes]]) -> bytes:
    wire = bytearray(
        b"\xff\xff\xfd\x00\xfe" + (1 + sum(4 + len(d) for _, d in parts)).to_bytes(2, "little") + b"\x55"
    )
    for device, data in parts:
        wire += bytes((0, device)) + data
        wire += crc16(wire).to_bytes(2, "little")
    return bytes(wire)


def parts_of(wire: bytes | bytearray, piece: int) -> list[bytes]:
    answer = FastAnswer([1, 2, 3], 4)
    found = [
        part.data for at in range(0, len(wire), piece) for part in answer.feed(bytes(wire[at : at + piece]))
    ]
    assert answer.missing == 3 - len(found)
    return found


@pytest.mark.parametrize("piece", [1, 7, 100])
def test_a_fast_answer_is_checked_part_by_part_while_it_arrives(piece: int) -> None:
    data = [b"\xff\xff\xfd\x00", b"\x01\x02\x03\x04", b"abcd"]
    wire = fast_answer(list(zip((1, 2, 3), data, strict=True)))
    late = fast_answer([(1, b"abcdefg")])
    echo = packets.sync_read(132, 4, [1, 2, 3], fast=True)
    assert parts_of(wire, piece) == parts_of(echo + late + wire, piece) == data
    assert parts_of(wire[:-5], piece) == data[:2]
    hit = bytearray(wire)
    hit[19] ^= 8
    assert parts_of(hit, piece) == data[:1]
    assert parts_of(b"", piece) == []


def test_late_fast_answers_are_counted_and_a_beginning_is_seen() -> None:
    answer = FastAnswer([1, 2, 3], 4)
    assert not answer.started
    assert not list(answer.feed(fast_answer([(1, b"abcdefg")])))
    assert (answer.late, answer.started) == (1, False)
    assert not list(answer.feed(packets.HEADER + b"\xfe"))
    assert answer.started


@given(st.binary(max_size=30), st.binary(max_size=10), st.integers(0, 40))
def test_a_status_is_taken_quickly_or_as_slowly_as_any_packet(
    parameters: bytes, after: bytes, size: int
) -> None:
    """`take` is the oracle: the quick way gives the same or leaves the stream as it was."""
    wire = build_status(7, 0x80, parameters)
    stream, whole = bytearray(wire + after), bytearray(wire + after)
    if not wire.startswith(packets.status_head(7, size)):
        return
    quick = packets.take_status(stream, size)
    packet = take(whole)
    assert packet is not None
    if quick is None:
        assert stream == wire + after
        assert len(packet.parameters) != size  # stuffing made the length the same
    else:
        assert (quick, stream) == ((packet.error, packet.parameters), whole)


@given(st.binary(max_size=80), st.integers(0, 0xFFFF))
def test_the_crc_is_that_of_the_vendor(data: bytes, start: int) -> None:
    handler = sdk.protocol2_packet_handler.Protocol2PacketHandler()
    assert crc16(data, start) == handler.updateCRC(start, data, len(data))
