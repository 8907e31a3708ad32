"""Messages of NatNet beside the frames: connection, clock, requests.

A message is its number and the size of what follows, two bytes each. The numbers are those of
`NatNetTypes.h`.
"""

from __future__ import annotations

import enum
import struct
from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import Final

from contid_mocap.byte_reader import ByteReader, PacketError

#: Major and minor number of a version of the protocol.
NatNetVersion = tuple[int, int]
VERSIONS: Final[tuple[NatNetVersion, ...]] = ((3, 0), (3, 1), (4, 0), (4, 1))
COMMAND_PORT: Final = 1510

_HEADER: Final = struct.Struct("<HH")
_SENDER: Final = struct.Struct("<256s4B4B")
_CONNECTION: Final = struct.Struct("<QH?4B")
_TICKS: Final = struct.Struct("<Q")
_ECHO: Final = struct.Struct("<QQ")


class MessageId(enum.IntEnum):
    """Numbers of the messages that are used here."""

    CONNECT = 0
    SERVER_INFO = 1
    REQUEST_MODELS = 4
    MODELS = 5
    FRAME = 7
    KEEP_ALIVE = 10
    ECHO_REQUEST = 12
    ECHO_RESPONSE = 13


@dataclass(frozen=True, slots=True)
class ServerInfo:
    """What a server answers to a connection.

    Attributes:
        application: its name.
        version: of the protocol.
        ticks_per_s: of the clock of its time stamps.
        data_port: port of its multicast.
        multicast: group address, None of a server that sends to each client.
    """

    application: str
    version: NatNetVersion
    ticks_per_s: int
    data_port: int
    multicast: IPv4Address | None


@dataclass(frozen=True, slots=True)
class Echo:
    """The answer to an echo request: the number that was sent, and the time of the server [ticks]."""

    sent: int
    ticks: int


def split(datagram: bytes) -> tuple[int, ByteReader]:
    """Number and contents of a message.

    Raises:
        PacketError: shorter than its header announces.
    """
    reader = ByteReader(datagram)
    message, size = reader.take(_HEADER)
    return int(message), reader.part(int(size))


def connect(version: NatNetVersion) -> bytes:
    """The request for the server's properties, and for frames of a version.

    The name and two versions of the sender, then the options of NatNet 4: all data, version of the frames.
    """
    major, minor = version
    sender = _SENDER.pack(b"Ping", major, minor, 0, 0, major, minor, 0, 0)
    return _message(MessageId.CONNECT, sender + bytes((0, major, minor, 0, 0, 0)))


def request_models() -> bytes:
    """The request for names and numbers."""
    return _message(MessageId.REQUEST_MODELS, b"")


def keep_alive() -> bytes:
    """What a client without multicast sends, or the server stops."""
    return _message(MessageId.KEEP_ALIVE, b"")


def echo_request(number: int) -> bytes:
    """A request that the server answers at once with its time."""
    return _message(MessageId.ECHO_REQUEST, _TICKS.pack(number))


def read_server_info(contents: ByteReader) -> ServerInfo:
    """The answer to `connect`.

    Raises:
        PacketError: cut, or of a server before NatNet 3.
    """
    name, *numbers = contents.take(_SENDER)
    version = (int(numbers[4]), int(numbers[5]))
    if version < VERSIONS[0]:
        raise PacketError(f"the server has NatNet {version[0]}.{version[1]}; 3.0 or later is needed")
    ticks_per_s, port, multicast, *group = contents.take(_CONNECTION)
    if ticks_per_s == 0:
        raise PacketError("the server states a clock of 0 ticks a second")
    application = name.partition(b"\0")[0].decode("utf-8", "replace")
    address = IPv4Address(bytes(group)) if multicast else None
    return ServerInfo(application, version, int(ticks_per_s), int(port), address)


def read_echo(contents: ByteReader) -> Echo:
    """The answer to `echo_request`; raises `PacketError` when it is cut."""
    sent, ticks = contents.take(_ECHO)
    return Echo(int(sent), int(ticks))


def _message(number: MessageId, contents: bytes) -> bytes:
    return _HEADER.pack(number, len(contents)) + contents
