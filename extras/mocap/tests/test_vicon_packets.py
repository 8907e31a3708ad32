"""Packets of the Vicon UDP object stream: layout by hand, angles by SciPy, and packets that are wrong."""

import math
import random
import struct
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contid_mocap.byte_reader import PacketError
from contid_mocap.emulate.vicon_packets import object_packets
from contid_mocap.vicon.packet import BLOCKS, read_packet, rotation_of_angles

#: Two objects in a block of 256 bytes, field by field as `python_udp_read_raw_data.py` of
#: TheWorkshopByGM/Vicon_UDP_Stream lists their places.
BY_HAND = (
    bytes.fromhex("39300000")  # B000-B003 FrameNumber, uint32: 12345
    + bytes.fromhex("02")  # B004 ItemsInBlock, uint8
    + bytes.fromhex("00")  # B005 ItemID, uint8: 0 for an object
    + bytes.fromhex("4800")  # B006-B007 ItemDataSize, uint16: 72
    + b"tip".ljust(24, b"\0")  # B008-B031 ItemName
    + bytes.fromhex("000000000000f83f")  # B032-B039 TransX, double: 1.5
    + bytes.fromhex("00000000000004c0")  # B040-B047 TransY: -2.5
    + bytes.fromhex("0000000000408f40")  # B048-B055 TransZ: 1000
    + bytes.fromhex("182d4454fb21f93f")  # B056-B063 RotX: pi / 2
    + bytes(8)  # B064-B071 RotY: 0
    + bytes(8)  # B072-B079 RotZ: 0
    + bytes.fromhex("004800")  # B080-B082 the head of the next item
    + b"lost".ljust(24, b"\0")
    + bytes(48)
).ljust(256, b"\0")


def test_a_packet_by_hand_is_read():
    packet = read_packet(BY_HAND)
    assert packet.number == 12345
    tip = packet.poses["tip"]
    assert tip is not None
    assert tip.position_m == (0.0015, -0.0025, 1.0)
    # A quarter turn about x takes y to z.
    assert np.asarray(tip.rotation) @ [0.0, 1.0, 0.0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)
    assert packet.poses["lost"] is None
    assert object_packets(
        12345, {"tip": (1.5, -2.5, 1000.0, math.pi / 2, 0.0, 0.0), "lost": (0.0,) * 6}, 256
    ) == [BY_HAND]


@pytest.mark.parametrize(("fixed_axes", "sequence"), [(False, "XYZ"), (True, "xyz")])
def test_angles_turn_as_in_scipy(fixed_axes, sequence):
    rng = np.random.default_rng(1)
    for angles in rng.uniform(-3, 3, (50, 3)):
        expected = Rotation.from_euler(sequence, angles).as_matrix()
        assert rotation_of_angles(tuple(angles), fixed_axes) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("block", BLOCKS)
def test_objects_that_do_not_fit_come_in_further_packets(block):
    objects = {f"object{k}": (float(k), 0.0, 1.0, 0.1, 0.2, 0.3) for k in range(20)}
    packets = object_packets(2**32 - 1, objects, block)
    assert all(len(packet) == block for packet in packets)
    poses: dict[str, Any] = {}
    for packet in packets:
        found = read_packet(packet)
        assert found.number == 2**32 - 1
        poses |= found.poses
    assert poses.keys() == objects.keys()
    assert all(poses[f"object{k}"].position_m[0] == pytest.approx(k / 1e3) for k in range(20))


@pytest.mark.parametrize("size", [0, 4, 80, 255, 257, 1025])
def test_packets_of_another_size_are_refused(size):
    with pytest.raises(PacketError, match="blocks have 256, 512 or 1024"):
        read_packet(BY_HAND.ljust(1025, b"\0")[:size])


def survive(number, seed):
    rng = random.Random(seed)
    objects: dict[str, Any] = {f"o{k}": tuple(rng.gauss(0, 1) for _ in range(6)) for k in range(6)}
    packets = [packet for block in BLOCKS for packet in object_packets(7, objects, block)]
    usable = 0
    for _ in range(number):
        data = bytearray(rng.choice(packets))
        for _ in range(rng.randrange(1, 8)):
            at = rng.randrange(rng.choice([8, 90, len(data)]))
            wrong = [rng.randbytes(1), struct.pack("<d", math.nan), struct.pack("<H", rng.getrandbits(16))]
            part = rng.choice(wrong)[: len(data) - at]
            data[at : at + len(part)] = part
        if rng.random() < 0.1:
            del data[rng.randrange(len(data)) :]
        try:
            packet = read_packet(bytes(data))
        except PacketError:
            continue
        ends = [bytes(data[k : k + (len(data) - k) // 8 * 8]) for k in range(8)]
        held = np.concatenate([np.frombuffer(each, "<f8") for each in ends])
        held = held[np.abs(held) <= 1e6] / 1e3
        for pose in packet.poses.values():
            if pose is None:
                continue
            usable += 1
            assert all(abs(value) <= 1000.0 for value in pose.position_m)
            assert np.isin(pose.position_m, held).all()
            turn = np.asarray(pose.rotation)
            assert np.abs(turn @ turn.T - np.eye(3)).max() < 1e-9
    assert usable > number / 10


def test_mutated_packets_raise_nothing_else_and_give_only_finite_poses():
    survive(4000, 1)


@pytest.mark.campaign
def test_a_hundred_thousand_mutated_packets():
    survive(100_000, 2)
