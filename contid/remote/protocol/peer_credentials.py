"""Who is at the other end of a Unix socket, as the kernel says, and whether they belong here.

The daemon's own user and root do; members of one group do when the daemon was told so (``--socket-group``),
which is how people reach the daemon of a service. The file's mode says the same to the kernel.
"""

from __future__ import annotations

import grp
import os
import socket
import struct
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

_CREDENTIALS: Final = struct.Struct("3i")  # pid, uid, gid
#: Linux's SO_PEERGROUPS (asm-generic/socket.h), which the socket module has no name for.
_SO_PEERGROUPS: Final = 59
#: Bytes for 256 groups, the most that Python's getsockopt takes.
_MOST_BYTES: Final = 1024


@dataclass(frozen=True, slots=True)
class PeerCredentials:
    """A user with every group of theirs."""

    uid: int
    groups: frozenset[int]


def peer_of(connected: socket.socket) -> PeerCredentials:
    """Who connected.

    Raises:
        OSError: gone already.
    """
    _, uid, gid = _CREDENTIALS.unpack(
        connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    )
    raw = b""
    with suppress(OSError):  # more than 256 groups, or a kernel before 4.13: only the first one counts
        raw = connected.getsockopt(socket.SOL_SOCKET, _SO_PEERGROUPS, _MOST_BYTES)
    return PeerCredentials(uid, frozenset((gid, *struct.unpack(f"{len(raw) // 4}I", raw))))


def is_authorized(peer: PeerCredentials, group: int | None) -> bool:
    """The daemon's own user, root, and members of the socket's group, if it has one."""
    return peer.uid in (os.geteuid(), 0) or (group is not None and group in peer.groups)


def group_id(name: str) -> int | None:
    """The number of a group, None when there is none of this name."""
    try:
        return grp.getgrnam(name).gr_gid
    except KeyError:
        return None
