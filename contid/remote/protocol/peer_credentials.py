"""Credentials of the peer of a Unix socket, from the kernel, and the role that they give it.

The daemon's own user, root, and the members of one group (``--socket-group``) may do everything; the members
of another (``--watch-group``) may read and stop. The mode of the socket file enforces the same for one group.
"""

from __future__ import annotations

import enum
import os
import socket
import struct
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

_CREDENTIALS: Final = struct.Struct("iII")  # pid, uid, gid
#: Linux's SO_PEERGROUPS (asm-generic/socket.h), absent from the socket module.
_SO_PEERGROUPS: Final = 59
#: Bytes for 256 groups, the maximum of Python's getsockopt.
_MAX_BYTES: Final = 1024


@dataclass(frozen=True, slots=True)
class PeerCredentials:
    """A user and all its groups."""

    uid: int
    groups: frozenset[int]


def peer_of(connected: socket.socket) -> PeerCredentials:
    """The credentials of the peer.

    Raises:
        OSError: it disconnected.
    """
    _, uid, gid = _CREDENTIALS.unpack(
        connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    )
    raw = b""
    with suppress(OSError):  # more than 256 groups, or a kernel before 4.13: only the primary one counts
        raw = connected.getsockopt(socket.SOL_SOCKET, _SO_PEERGROUPS, _MAX_BYTES)
    return PeerCredentials(uid, frozenset((gid, *struct.unpack(f"{len(raw) // 4}I", raw))))


class ClientRole(enum.Enum):
    """What a client may do."""

    ALL = "all"
    WATCH = "watch"  # read, and stop


def role_of(peer: PeerCredentials, group: int | None, watch_group: int | None = None) -> ClientRole | None:
    """The role of a peer, None when it may not connect.

    Args:
        peer: its credentials.
        group: whose members may do everything, None for no group.
        watch_group: whose members may read and stop, None for no group.
    """
    if peer.uid in (os.geteuid(), 0) or (group is not None and group in peer.groups):
        return ClientRole.ALL
    return ClientRole.WATCH if watch_group is not None and watch_group in peer.groups else None
