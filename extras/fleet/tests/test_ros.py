"""What is published for ROS 2, piece by piece against others: no machine with ROS 2 is here.

Keys and tokens: verbatim from docs/design.md of https://github.com/ros2/rmw_zenoh. Hashes: printed by
machines with ROS 2 (`ros2 topic info -v`). Attachments: the serializer of zenoh-ext. CDR: `rosbags`, and by
hand after https://www.omg.org/spec/DDSI-RTPS/2.5/PDF (plain CDR, little endian).
"""

from __future__ import annotations

import json
import math
import queue
import struct
import subprocess
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from contid.errors import ContidError
from contid.robot_file.base import Quantity
from contid_fleet.keys import Keys
from contid_fleet.net import NetSession
from contid_fleet.net_settings import NetSettings
from contid_fleet.operator import FleetOperator
from contid_fleet.ros.keys import QOS, RosNode, RosTopic, attachment, dds_type, ros_name
from contid_fleet.ros.messages import NodeMessages, RosMessage, type_hash, type_store
from contid_fleet.ros.view import RosView
from tests.support.command import contid
from tests.support.daemons import armed, arrives, command, daemon
from tests.support.fleets import bridge
from tests.support.ports import free_port
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

pytest.importorskip("rosbags", reason="needs the extra contid[ros]")

STRING = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
DESCRIBED: dict[str, Any] = {
    "robots": {
        "f0": {"unit": "mm", "axes": {axis: {"min_mm": 0.0, "max_mm": 99.0} for axis in ("left", "right")}},
        "arm-1": {"unit": "bar", "axes": {"a": {"min_bar": 0.0, "max_bar": 2.0}}},
    }
}
FRAME: dict[str, Any] = {
    "t_s": 5.0,
    "robots": {
        "f0": {"state": "RUN", "fault": 0, "tip_mm": [10.0, -20.5, 85.0], "measured": [60.0, 61.25]},
        "arm-1": {"state": "FAULT", "fault": 110, "tip_mm": None, "measured": [1.5]},
    },
}
TIME_NS = 1_700_000_000_123_456_789


def test_tokens_are_those_of_rmw_zenoh() -> None:
    listener = RosNode(0, "aac3178e146ba6f1fc6e6a4085e77f21", "listener")
    assert listener.token() == "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
    talker = RosNode(0, "8b20917502ee955ac4476e0266340d5c", "talker")
    topic = RosTopic(talker, 10, "/chatter", "std_msgs/msg/String", STRING)
    # In the document the talker keeps 7, and this publisher 10.
    assert topic.token().removesuffix(QOS) + "::,7:,:,:,," == (
        "@ros2_lv/0/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/"
        f"%chatter/std_msgs::msg::dds_::String_/{STRING}/::,7:,:,:,,"
    )
    assert topic.key == f"0/chatter/std_msgs::msg::dds_::String_/{STRING}"
    assert len(topic.gid()) == 16


@pytest.mark.parametrize(
    ("type_name", "expected"),
    [
        ("std_msgs/msg/String", STRING),
        (
            "sensor_msgs/msg/JointState",
            "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
        ),
        ("tf2_msgs/msg/TFMessage", "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"),
    ],
)
def test_hashes_are_those_of_machines_with_ros_2(type_name: str, expected: str) -> None:
    assert type_hash(type_name) == expected


def test_an_attachment_is_what_the_serializer_of_zenoh_writes() -> None:
    from zenoh import ext

    gid = bytes(range(16))
    fields: Any = (ext.Int64(7), ext.Int64(TIME_NS), gid)
    assert attachment(7, TIME_NS, gid) == ext.z_serialize(fields).to_bytes()


def test_names_are_names_of_ros_2() -> None:
    assert [ros_name(name) for name in ("hand1", "left.hand-2", "3d")] == ["hand1", "left_hand_2", "_3d"]
    twice = {"robots": {"a-1": {"unit": "mm", "axes": {}}, "a.1": {"unit": "mm", "axes": {}}}}
    with pytest.raises(ContidError, match="the same name in ROS 2"):
        NodeMessages("hand1", twice)


def test_units_are_those_of_the_daemon() -> None:
    assert (Quantity.LENGTH.unit, Quantity.PRESSURE.unit) == ("mm", "bar")


def made() -> dict[str, RosMessage]:
    return {each.topic: each for each in NodeMessages("hand1", DESCRIBED).messages(FRAME, TIME_NS)}


def test_topics_of_a_frame() -> None:
    assert {topic: each.type_name for topic, each in made().items()} == {
        "/contid/hand1/f0/joint_states": "sensor_msgs/msg/JointState",
        "/contid/hand1/f0/tip": "geometry_msgs/msg/PointStamped",
        "/contid/hand1/arm_1/a/pressure": "sensor_msgs/msg/FluidPressure",
        "/tf": "tf2_msgs/msg/TFMessage",
        "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    }


class Cdr:
    """Reads plain CDR, little endian: each value is aligned to its size from the end of the head."""

    def __init__(self, payload: bytes) -> None:
        assert payload[:4] == b"\0\1\0\0"
        self._rest, self._at = payload[4:], 0

    def value(self, code: str) -> Any:
        size = struct.calcsize(code)
        self._at += -self._at % size
        (found,) = struct.unpack_from("<" + code, self._rest, self._at)
        self._at += size
        return found

    def text(self) -> str:
        length = self.value("I")
        found = self._rest[self._at : self._at + length]
        self._at += length
        assert found.endswith(b"\0")
        return found[:-1].decode()

    def header(self) -> tuple[int, str]:
        seconds, nanoseconds = self.value("i"), self.value("I")
        return seconds * 10**9 + nanoseconds, self.text()

    def doubles(self) -> list[float]:
        return [self.value("d") for _ in range(self.value("I"))]

    def ended(self) -> bool:
        return self._at == len(self._rest)


def test_the_bytes_by_hand() -> None:
    messages = made()
    joints = Cdr(messages["/contid/hand1/f0/joint_states"].payload)
    assert joints.header() == (TIME_NS, "")
    assert [joints.text() for _ in range(joints.value("I"))] == ["f0_left", "f0_right"]
    assert joints.doubles() == pytest.approx([0.060, 0.06125])
    assert (joints.doubles(), joints.doubles()) == ([], [])
    assert joints.ended()
    tip = Cdr(messages["/contid/hand1/f0/tip"].payload)
    assert tip.header() == (TIME_NS, "world")
    assert [tip.value("d") for _ in range(3)] == pytest.approx([0.01, -0.0205, 0.085])
    assert tip.ended()
    pressure = Cdr(messages["/contid/hand1/arm_1/a/pressure"].payload)
    assert pressure.header() == (TIME_NS, "arm_1_a")
    assert (pressure.value("d"), pressure.value("d")) == (150_000.0, 0.0)
    assert pressure.ended()


def test_extra_axes_have_units_of_their_own() -> None:
    """A turntable below an arm of pressures, and one below a finger, are joints [rad]."""
    turn = {"turn": {"min_deg": -90.0, "max_deg": 90.0}}
    described = {
        "robots": {
            name: {**robot, "axes": robot["axes"] | turn} for name, robot in DESCRIBED["robots"].items()
        }
    }
    robots = {
        name: {**robot, "measured": [*robot["measured"], 90.0]} for name, robot in FRAME["robots"].items()
    }
    found = {
        each.topic: each
        for each in NodeMessages("hand1", described).messages({"t_s": 5.0, "robots": robots}, TIME_NS)
    }
    finger = read(found["/contid/hand1/f0/joint_states"])
    assert finger.name == ["f0_left", "f0_right", "f0_turn"]
    assert finger.position == pytest.approx([0.060, 0.06125, math.pi / 2.0])
    arm = read(found["/contid/hand1/arm_1/joint_states"])
    assert (arm.name, arm.position) == (["arm_1_turn"], pytest.approx([math.pi / 2.0]))
    assert read(found["/contid/hand1/arm_1/a/pressure"]).fluid_pressure == pytest.approx(150_000.0)
    assert "/contid/hand1/arm_1/turn/pressure" not in found


def read(message: RosMessage) -> Any:
    return type_store().deserialize_cdr(message.payload, message.type_name)


def test_transforms_and_faults() -> None:
    messages = made()
    (transform,) = read(messages["/tf"]).transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("world", "hand1_f0_tip")
    translation, rotation = transform.transform.translation, transform.transform.rotation
    assert (translation.x, translation.y, translation.z) == pytest.approx((0.01, -0.0205, 0.085))
    assert (rotation.x, rotation.y, rotation.z, rotation.w) == (0.0, 0.0, 0.0, 1.0)
    one, two = read(messages["/diagnostics"]).status
    assert (one.level, one.name, one.message) == (0, "hand1: f0", "RUN")
    assert (two.level, two.name, two.message) == (2, "hand1: arm-1", "FAULT, fault 110")
    assert {each.key: each.value for each in two.values} == {"state": "FAULT", "fault": "110"}


def test_a_reader_finds_and_receives_a_real_robot() -> None:
    """The reader is a peer as rmw_zenoh configures one, at a router; it finds topics by tokens alone."""
    import zenoh

    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        router = NetSession(NetSettings([endpoint], mode="router"))
        stack.callback(router.close)
        config = {
            "mode": "peer",
            "connect": {"endpoints": [endpoint]},
            "listen": {"endpoints": ["tcp/127.0.0.1:0"]},
            "scouting": {"multicast": {"enabled": False}},
        }
        reader = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
        stack.callback(reader.close)
        tokens: dict[str, None] = {}
        samples: dict[str, Any] = {}
        seen = reader.liveliness().declare_subscriber(
            "@ros2_lv/5/**", lambda sample: tokens.setdefault(str(sample.key_expr)), history=True
        )
        received = reader.declare_subscriber(
            "5/**", lambda sample: samples.update({str(sample.key_expr): sample})
        )
        node = stack.enter_context(daemon())
        with node.client() as client:
            armed(client)
            client.move({"x_mm": 30.0, "y_mm": 85.0})
            arrives(client, "f0", (30.0, 85.0, 0.0))
        served = stack.enter_context(bridge({"hand1": node.socket}))
        path = str(served.operator_file("bob"))
        program = subprocess.Popen(
            command("fleet", "ros", "--router", endpoint, "--domain", "5", "--file", path),
            stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        stack.callback(program.communicate)
        stack.callback(program.terminate)
        until(lambda: len(samples) == 4 and len(tokens) == 5, "a robot is published")
        publishers = [token.split("/") for token in tokens if "/MP/" in token]
        found = {
            f"{domain}/{topic.strip('%').replace('%', '/')}/{kind}/{hashed}"
            for _, domain, _, _, _, _, _, _, name, topic, kind, hashed, _ in publishers
            if name == "contid_fleet"
        }
        assert found == samples.keys()
        key = f"5/contid/hand1/f0/tip/{dds_type('geometry_msgs/msg/PointStamped')}/"
        (sample,) = (sample for name, sample in samples.items() if name.startswith(key))
        tip = type_store().deserialize_cdr(sample.payload.to_bytes(), "geometry_msgs/msg/PointStamped")
        assert (tip.point.x, tip.point.y) == pytest.approx((0.030, 0.085), abs=5e-4)
        age_s = time.time() - (tip.header.stamp.sec + tip.header.stamp.nanosec * 1e-9)
        assert -0.05 < age_s < 60.0
        number, _, length = struct.unpack_from("<qqB", sample.attachment.to_bytes())
        assert number >= 1
        assert length == 16
        seen.undeclare()
        received.undeclare()


def test_a_router_elsewhere_and_one_that_is_absent_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "fleet.yaml"
    path.write_text("fleet: lab\noperator: bob\nconnect: [tcp/127.0.0.1:1]\n")
    elsewhere = contid("fleet", "ros", "--router", "tcp/10.0.0.1:7447", "--file", str(path))
    assert elsewhere.returncode == 2
    assert "leaves this machine without TLS" in elsewhere.stderr
    absent = contid("fleet", "ros", "--router", f"tcp/127.0.0.1:{free_port()}", "--file", str(path))
    assert absent.returncode == 4
    assert "Unable to connect" in absent.stderr


class Watched:
    """An operator of one node whose clock is ahead by ``offset_s``."""

    def __init__(self) -> None:
        self.offset_s = 1000.0
        self.left: list[Callable[[], object]] = []
        self.net = SimpleNamespace(subscribe=lambda key, received: None)
        self.keys = Keys("lab")

    def ask(self, *_: object) -> dict[str, Any]:
        return {"ok": True, "result": DESCRIBED}

    def timed_ask(self, *_: object, **__: object) -> tuple[float, dict[str, Any]]:
        now_s = time.monotonic()
        return now_s, {"ok": True, "result": {"monotonic_ns": (now_s + self.offset_s) * 1e9}}

    def on_leave(self, node: str, left: Callable[[], object]) -> Callable[[], None]:
        self.left.append(left)
        return lambda: self.left.remove(left)


def test_after_a_restart_of_its_machine_a_node_has_another_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("contid_fleet.ros.view.RETRY_S", 0.0)
    operator, sent = Watched(), []
    publisher: Any = SimpleNamespace(publish=lambda message: sent.append(message))
    view = RosView(cast(FleetOperator, operator), publisher, lambda text: None)

    def late_s() -> float:
        now_s, frame = time.time(), {**FRAME, "t_s": time.monotonic() + operator.offset_s}
        view.show("hand1", frame)
        stamp = read(sent[-1]).header.stamp
        return float(now_s - stamp.sec - 1e-9 * stamp.nanosec)

    assert abs(late_s()) < 1.0
    operator.offset_s = -50.0
    for left in operator.left:
        left()
    assert abs(late_s()) < 1.0
    assert len(operator.left) == 1


def test_a_queue_that_was_emptied_meanwhile_does_not_block() -> None:
    view = RosView(cast(FleetOperator, Watched()), cast(Any, None), lambda text: None)

    class Full(queue.Queue[tuple[str, bytes]]):
        refused = 0

        def put_nowait(self, item: tuple[str, bytes]) -> None:
            self.refused += 1
            if self.refused == 1:
                raise queue.Full
            super().put_nowait(item)

    view._frames = Full()
    putting = threading.Thread(target=view._put, args=("key", b"line"), daemon=True)
    putting.start()
    putting.join(5.0)
    assert not putting.is_alive()
    assert view._frames.get_nowait() == ("key", b"line")
