"""NatNet packets: a packet of Motive, another client as witness, and packets that are wrong."""

import hashlib
import math
import random
import struct

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contid_mocap.byte_reader import PacketError
from contid_mocap.emulate.natnet_packets import (
    SentBody,
    SentFrame,
    SentMarker,
    SentTimes,
    frame_packet,
    message,
    models_packet,
    server_packet,
)
from contid_mocap.natnet import messages
from contid_mocap.natnet.frame import read_frame
from contid_mocap.natnet.models import read_models
from tests.support.mocap.rooms import VERSIONS, random_frame

#: Frame 162734 of Motive 2.1 (NatNet 3.0): the numbers are printed in tests/test_MocapFrameMessage.py of
#: mje-nz/python_natnet, and agree with the SDK's SampleClient there; the packet itself is
#: test_data/mocapframe_packet_v3.bin, of which only the digest stands here.
MOTIVE = SentFrame(
    162734,
    SentTimes(1356.1166666666666, 1416497730518, 1416497745808, 1416497748722),
    bodies=[
        SentBody(
            2,
            (0.17444664239883423, 1.4471313953399658, -0.7343040108680725),
            (-0.05459423363208771, 0.509948194026947, 0.04370357096195221, -0.8573576807975769),
            0.0005152203375473619,
        )
    ],
    # The labelled markers of the body, which the packet lists as "other markers" too, and a stray one.
    others=[
        (0.12721621990203857, 1.5050275325775146, -0.8858283758163452),
        (0.20898520946502686, 1.4832806587219238, -0.7121866345405579),
        (-0.04574164003133774, 1.4310429096221924, -0.8313022255897522),
        (0.18133828043937683, 1.4358338117599487, -0.6535942554473877),
        (0.32139891386032104, 1.4146512746810913, -0.7529537677764893),
    ],
    labelled=[
        SentMarker(2 << 16 | 1, (0.12721621990203857, 1.5050275325775146, -0.8858283758163452),
                   0.021439820528030396, 10, 0.00020748283714056015),
        SentMarker(2 << 16 | 2, (0.20898520946502686, 1.4832806587219238, -0.7121866345405579),
                   0.020884789526462555, 10, 0.000539067666977644),
        SentMarker(2 << 16 | 3, (-0.04574164003133774, 1.4310429096221924, -0.8313022255897522),
                   0.020809074863791466, 10, 0.000689117528963834),
        SentMarker(2 << 16 | 4, (0.18133828043937683, 1.4358338117599487, -0.6535942554473877),
                   0.019269507378339767, 10, 0.0003837273397948593),
        SentMarker(2 << 16 | 5, (0.32139891386032104, 1.4146512746810913, -0.7529537677764893),
                   0.021224740892648697, 10, 0.0006357387755997479),
        SentMarker(50007, (0.17081165313720703, 1.5076590776443481, -0.840234637260437),
                   0.0201573446393013, 18, 0.0005593782989308238),
    ],
)  # fmt: skip
MOTIVE_SHA256 = "b0fdf27bf39ee515d97b8d28040293196f9b506fe04d868bd62bd9768ddcee3f"


def decoded(packet, version):
    number, contents = messages.split(packet)
    assert number == messages.MessageId.FRAME
    return read_frame(contents, version)


def test_the_encoder_makes_the_packet_that_motive_sent_and_the_decoder_reads_it():
    packet = frame_packet(MOTIVE, (3, 0))
    assert hashlib.sha256(packet).hexdigest() == MOTIVE_SHA256
    frame = decoded(packet, (3, 0))
    assert frame.number == 162734
    assert (frame.exposed, frame.sent) == (1416497730518, 1416497748722)
    body = frame.bodies[2]
    assert body.position_m == pytest.approx((0.1744466, 1.4471314, -0.7343040), abs=1e-7)
    turn = Rotation.from_quat([-0.05459423, 0.5099482, 0.04370357, -0.8573577]).as_matrix()
    assert np.asarray(body.rotation) == pytest.approx(turn, abs=1e-6)
    assert body.error_m == pytest.approx(0.0005152203)


@pytest.mark.parametrize("version", VERSIONS)
def test_another_client_reads_the_same_in_every_packet(version):
    """The package `natnet` of Tim Schneider decodes the same packets; it has no code in common."""
    natnet = pytest.importorskip("natnet.data_frame")
    from natnet.packet_buffer import PacketBuffer
    from natnet.version import Version

    rng = random.Random(version[0] * 10 + version[1])
    for _ in range(150):
        packet = frame_packet(random_frame(rng, version), version)
        witness = natnet.DataFrame.read_from_buffer(PacketBuffer(packet[4:]), Version(*version))
        frame = decoded(packet, version)
        assert frame.number == witness.prefix.frame_number
        assert frame.exposed == witness.suffix.stamp_camera_mid_exposure
        assert frame.sent == witness.suffix.stamp_transmit
        assert frame.sets == {each.model_name: list(each.marker_pos_list) for each in witness.marker_sets}
        assert frame.occluded == {each.pos for each in witness.labeled_markers if each.occluded}
        assert frame.bodies.keys() == {each.id_num for each in witness.rigid_bodies}
        for each in witness.rigid_bodies:
            body = frame.bodies[each.id_num]
            if not each.tracking_valid:
                assert body.position_m is None
                continue
            assert body.position_m == each.pos
            assert body.error_m == each.marker_error
            turn = Rotation.from_quat(each.rot).as_matrix()
            assert np.asarray(body.rotation) == pytest.approx(turn, abs=1e-6)


@pytest.mark.parametrize("version", VERSIONS)
def test_another_client_reads_the_same_names(version):
    natnet = pytest.importorskip("natnet.data_descriptions")
    from natnet.packet_buffer import PacketBuffer
    from natnet.version import Version

    packet = models_packet({7: "tip", 9: "Grundplatte ü"}, {"tip": ["a", "b"], "all": []}, version)
    witness = natnet.DataDescriptions.read_from_buffer(PacketBuffer(packet[4:]), Version(*version))
    models = read_models(messages.split(packet)[1], version)
    assert models.bodies == {each.id_num: each.name for each in witness.rigid_bodies}
    assert models.markers == {each.name: list(each.marker_names) for each in witness.marker_sets}
    assert models.bodies == {7: "tip", 9: "Grundplatte ü"}


def test_definitions_of_every_kind_are_passed():
    """Layouts of `PacketClient.cpp`: skeleton, force plate, device and camera stand before a body."""
    body = b"tip\0" + struct.pack("<2i3fi", 7, -1, 0, 0, 0, 0)
    plate = struct.pack("<i", 1) + b"AMTI\0" + struct.pack("<5f", *[0.5] * 5) + bytes(4 * 144 + 4 * 12)
    plate += struct.pack("<3i", 1, 0, 2) + b"Fx\0Fy\0"
    device = struct.pack("<i", 2) + b"NI\0" + b"serial\0" + struct.pack("<3i", 1, 0, 1) + b"ai0\0"
    camera = b"Prime\0" + struct.pack("<7f", *[0.0] * 7)
    skeleton = b"hand\0" + struct.pack("<2i", 1, 1) + body
    kinds = [(2, skeleton), (3, plate), (4, device), (5, camera), (1, body)]
    for version in VERSIONS:
        data = struct.pack("<i", len(kinds))
        for kind, definition in kinds:
            size = struct.pack("<i", len(definition)) if version >= (4, 1) else b""
            data += struct.pack("<i", kind) + size + definition
        models = read_models(messages.split(message(5, data))[1], version)
        assert models.bodies == {7: "tip"}
        assert models.unknown is None


def test_definitions_end_at_a_kind_without_a_size_that_is_not_known():
    """Before 4.1 nothing states where such a definition ends."""
    data = struct.pack("<2i", 3, 0) + b"set\0" + struct.pack("<i", 0) + struct.pack("<i", 6) + bytes(40)
    models = read_models(messages.split(message(5, data))[1], (3, 1))
    assert (models.markers, models.bodies, models.unknown) == ({"set": []}, {}, 6)


def test_what_a_later_version_adds_to_a_section_is_skipped():
    """From 4.1 the size of a section counts, not what this version reads of its elements."""
    frame = SentFrame(5, SentTimes(1.0, 10, 20, 30), bodies=[SentBody(7, (1.0, 2.0, 3.0), (0, 0, 0, 1.0))])
    packet = frame_packet(frame, (4, 1))
    place = packet.index(struct.pack("<3f", 1.0, 2.0, 3.0)) - 4
    longer = bytearray(packet[:place] + packet[place : place + 38] + bytes(6) + packet[place + 38 :])
    struct.pack_into("<i", longer, place - 4, 38 + 6)
    struct.pack_into("<H", longer, 2, len(longer) - 4)
    assert decoded(bytes(longer), (4, 1)).bodies[7].position_m == (1.0, 2.0, 3.0)
    assert decoded(bytes(longer), (4, 1)).sent == 30
    struct.pack_into("<i", longer, place - 4, 30)
    with pytest.raises(PacketError, match="do not fit"):
        decoded(bytes(longer), (4, 1))


def test_a_server_is_read_as_it_answers():
    """Motive 2.1: `serverinfo_packet_v3.bin` of mje-nz/python_natnet has these numbers."""
    packet = server_packet((3, 0), 3312787, 1511, bytes((239, 255, 42, 99)))
    info = messages.read_server_info(messages.split(packet)[1])
    assert (info.version, info.ticks_per_s, info.data_port) == ((3, 0), 3312787, 1511)
    assert str(info.multicast) == "239.255.42.99"
    with pytest.raises(PacketError, match=r"NatNet 2.9; 3.0 or later"):
        messages.read_server_info(messages.split(server_packet((2, 9), 1, 1, None))[1])


def test_numbers_that_are_no_pose_are_not_tracked():
    good = (0.0, 0.0, 0.0, 1.0)
    for position, turn in (
        ((math.nan, 0.0, 0.0), good),
        ((math.inf, 0.0, 0.0), good),
        ((1e9, 0.0, 0.0), good),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)),
        ((0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0)),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.5, 1.0)),
    ):
        frame = SentFrame(1, SentTimes(0.0, 1, 2, 3), bodies=[SentBody(1, position, turn)])
        body = decoded(frame_packet(frame, (4, 0)), (4, 0)).bodies[1]
        assert body.position_m is None
        assert body.rotation is None


def mutated(rng, packet):
    """A packet with bytes changed, cut, doubled or moved, whose header still fits now and then."""
    data = bytearray(packet)
    for _ in range(rng.randrange(1, 6)):
        kind, at = rng.randrange(6), rng.randrange(len(data)) if data else 0
        if kind == 0 and data:
            data[at] = rng.randrange(256)
        elif kind == 1:
            del data[at : at + rng.randrange(1, 40)]
        elif kind == 2:
            data[at:at] = rng.randbytes(rng.randrange(1, 40))
        elif kind == 3:
            data[at : at + 4] = struct.pack("<i", rng.choice([-1, 2**31 - 1, 65535, 0, 1, 2, 1000]))
        elif kind == 4:
            data[at : at + 4] = struct.pack("<f", rng.choice([math.nan, math.inf, -math.inf, 3e38]))
        else:
            data[at:at] = data[at : at + rng.randrange(1, 80)]
    if rng.random() < 0.7 and len(data) >= 4:
        struct.pack_into("<HH", data, 0, packet[0], min(len(data) - 4, 65535))
    return bytes(data)


def survive(number, seed):
    rng, frames = random.Random(seed), 0
    packets = [(frame_packet(random_frame(rng, v), v), v) for v in VERSIONS for _ in range(25)]
    packets += [(models_packet({1: "a", 2: "b"}, {"s": ["m", "n"]}, v), v) for v in VERSIONS]
    packets += [(server_packet(v, 10**7, 1511, None), v) for v in VERSIONS]
    for _ in range(number):
        packet, version = packets[rng.randrange(len(packets))]
        packet = mutated(rng, packet)
        try:
            kind, contents = messages.split(packet)
            if kind == 5:
                read_models(contents, version)
            elif kind == 1:
                messages.read_server_info(contents)
            elif kind == 7:
                frame = read_frame(contents, version)
                frames += 1
                for body in frame.bodies.values():
                    if body.position_m is None:
                        continue
                    assert struct.pack("<3f", *body.position_m) in packet
                    assert all(abs(value) <= 1000.0 for value in body.position_m)
                    turn = np.asarray(body.rotation)
                    assert np.abs(turn @ turn.T - np.eye(3)).max() < 1e-9
        except PacketError:
            continue
    assert frames > number / 50


def test_mutated_packets_raise_nothing_else_and_give_only_poses_that_they_hold():
    survive(6000, 1)


@pytest.mark.campaign
def test_a_hundred_thousand_mutated_packets():
    survive(100_000, 2)
