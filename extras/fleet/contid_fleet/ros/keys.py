"""Keys, tokens and attachments of rmw_zenoh, by which programs of ROS 2 find and receive what is published.

After docs/design.md and rmw_zenoh_cpp/src/detail/{liveliness_utils,attachment_helpers}.cpp of
https://github.com/ros2/rmw_zenoh (Jazzy 0.2.4 and later):

    DOMAIN/TOPIC/TYPE/HASH                                       samples
    @ros2_lv/DOMAIN/ZID/NODE/ENTITY/KIND/ENCLAVE/NAMESPACE/NAME  a token of a node, and of its publishers with
        /TOPIC/TYPE/HASH/QOS                                     their topic
"""

from __future__ import annotations

import hashlib
import re
import struct
from dataclasses import dataclass
from typing import Final

ADMIN_SPACE: Final = "@ros2_lv"
#: Reliable, volatile, the newest ten; what is left empty has the default of rmw_zenoh.
QOS: Final = "::,10:,:,:,,"
GID_BYTES: Final = 16
#: A name of ROS 2: https://design.ros2.org/articles/topic_and_service_names.html
_FOREIGN: Final = re.compile(r"[^A-Za-z0-9_]")


def ros_name(name: str) -> str:
    """A name that ROS 2 allows in a topic: other characters become underscores, a leading digit gets one."""
    changed = _FOREIGN.sub("_", name)
    return f"_{changed}" if changed[:1].isdecimal() else changed


def dds_type(type_name: str) -> str:
    """``sensor_msgs/msg/JointState`` as rmw_zenoh writes it."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


@dataclass(frozen=True, slots=True)
class RosNode:
    """A node of ROS 2 in a session of Zenoh.

    Attributes:
        domain: ROS_DOMAIN_ID.
        session: identifier of the session (ZID), as Zenoh prints it.
        name: name of the node, in the root namespace.
    """

    domain: int
    session: str
    name: str

    def token(self) -> str:
        """The token of the node."""
        return f"{ADMIN_SPACE}/{self.domain}/{self.session}/0/0/NN/%/%/{self.name}"


@dataclass(frozen=True, slots=True)
class RosTopic:
    """A topic that a node publishes.

    Attributes:
        node: name of the node of the publisher.
        number: number of the publisher, from 1.
        name: name with its leading slash.
        type_name: ``sensor_msgs/msg/JointState``.
        type_hash: ``RIHS01_`` and 64 digits.
    """

    node: RosNode
    number: int
    name: str
    type_name: str
    type_hash: str

    @property
    def key(self) -> str:
        """The key of its samples."""
        return f"{self.node.domain}/{self.name.strip('/')}/{dds_type(self.type_name)}/{self.type_hash}"

    def token(self) -> str:
        """The token of the publisher."""
        node = f"{ADMIN_SPACE}/{self.node.domain}/{self.node.session}/0/{self.number}/MP/%/%/{self.node.name}"
        return f"{node}/{self.name.replace('/', '%')}/{dds_type(self.type_name)}/{self.type_hash}/{QOS}"

    def gid(self) -> bytes:
        """Identifies the publisher in attachments; rmw_zenoh makes it of the token by another hash."""
        return hashlib.blake2b(self.token().encode(), digest_size=GID_BYTES).digest()


def attachment(number: int, time_ns: int, gid: bytes) -> bytes:
    """The attachment of a sample: its number from 1, the time of day [ns], the GID of its publisher.

    rmw_zenoh drops a sample without it. The layout is that of the serializer of zenoh-ext.
    """
    return struct.pack("<qqB", number, time_ns, GID_BYTES) + gid
