"""UDP sockets of explicit addresses: only datagrams of one sender, with the kernel's time of arrival."""

from __future__ import annotations

import select
import socket
import struct
import time
from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import Final

from contid.errors import DeviceNotFoundError

#: Linux's SO_TIMESTAMPNS, which Python does not name.
_SO_TIMESTAMPNS: Final = 35
_TIMESPEC: Final = struct.Struct("@qq")
#: Largest datagram of IPv4.
_MAX_BYTES: Final = 65535
#: Datagrams of one look; more are left for the next.
_MAX_BATCH: Final = 256
_BUFFER_BYTES: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class Datagram:
    """A datagram and its arrival by `time.monotonic`."""

    data: bytes
    received_s: float


def open_socket(local: IPv4Address, port: int, group: IPv4Address | None = None) -> socket.socket:
    """A socket that receives at one address, or from a multicast group through the interface of that address.

    Args:
        local: address of this machine; 0.0.0.0 for all.
        port: 0 for any that is free.
        group: multicast group; datagrams to other addresses are then not received.

    Raises:
        DeviceNotFoundError: the address is not of this machine, or the port is in use.
    """
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setblocking(False)
        made.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        if group is None:
            made.bind((str(local), port))
        else:
            # Several programs of one machine may listen to a group.
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            made.bind((str(group), port))
            made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group.packed + local.packed)
    except OSError as error:
        made.close()
        place = f"{local if group is None else group}:{port}"
        remedy = "--local is an address of this machine, see `ip -4 address`; a port can have one program"
        raise DeviceNotFoundError(place, f"cannot receive there: {error.strerror}", remedy) from None
    return made


def receive(
    sockets: list[socket.socket], server: IPv4Address, timeout_s: float
) -> list[tuple[socket.socket, Datagram]]:
    """What has arrived from the server, in the order of arrival at each socket.

    Args:
        sockets: of `open_socket`.
        server: datagrams of others are dropped.
        timeout_s: longest wait for the first.
    """
    ready, _, _ = select.select(sockets, [], [], max(timeout_s, 0.0))
    found: list[tuple[socket.socket, Datagram]] = []
    for each in ready:
        for _ in range(_MAX_BATCH):
            try:
                data, ancillary, _, sender = each.recvmsg(_MAX_BYTES, 64)
            except OSError:
                break  # no more, or an answer of ICMP to an earlier datagram: nothing listens there
            if sender[0] == str(server):
                found.append((each, Datagram(data, _arrival_s(ancillary))))
    return found


def send(through: socket.socket, data: bytes, server: IPv4Address, port: int) -> None:
    """Send a datagram; one that cannot be sent now counts as lost on the way."""
    try:
        through.sendto(data, (str(server), port))
    except OSError:
        return


def _arrival_s(ancillary: list[tuple[int, int, bytes]]) -> float:
    """The kernel's time of arrival as `time.monotonic`; now where it gives none."""
    now_s = time.monotonic()
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS) and len(data) >= _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack_from(data)
            waited_s = (time.time_ns() - (seconds * 10**9 + nanoseconds)) * 1e-9
            # A step of the wall clock must not move a capture into the future or far into the past.
            if 0.0 <= waited_s <= 5.0:
                return now_s - float(waited_s)
    return now_s
