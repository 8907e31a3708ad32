"""Credentials of the peer of a socket."""

from __future__ import annotations

import os
import socket
import struct
from typing import cast

from contid.remote.protocol.peer_credentials import ClientRole, PeerCredentials, peer_of, role_of


def test_credentials_are_the_kernels() -> None:
    one, other = socket.socketpair()
    with one, other:
        peer = peer_of(one)
    assert peer.uid == os.geteuid()
    assert peer.groups == {os.getegid(), *os.getgroups()}
    own, root = PeerCredentials(os.geteuid(), frozenset()), PeerCredentials(0, frozenset())
    stranger = PeerCredentials(os.geteuid() + 1, frozenset({7, 8}))
    assert role_of(own, None) is role_of(root, None) is role_of(own, None, 8) is ClientRole.ALL
    assert role_of(stranger, None) is role_of(stranger, 9, 10) is None
    assert role_of(stranger, 8) is role_of(stranger, 8, 7) is ClientRole.ALL
    assert role_of(stranger, None, 8) is role_of(stranger, 9, 8) is ClientRole.WATCH


def test_numbers_of_users_and_groups_have_no_sign() -> None:
    """``uid_t`` is unsigned; directories map users to numbers above 2^31."""

    class Peer:
        def getsockopt(self, level: int, option: int, size: int) -> bytes:
            if option != socket.SO_PEERCRED:
                raise OSError
            return struct.pack("=iII", 1, 0xC0000001, 0xC0000002)

    assert peer_of(cast(socket.socket, Peer())) == PeerCredentials(0xC0000001, frozenset({0xC0000002}))
