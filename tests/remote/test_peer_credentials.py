"""Credentials of the peer of a socket."""

from __future__ import annotations

import os
import socket

from contid.remote.protocol.peer_credentials import PeerCredentials, is_authorized, peer_of


def test_credentials_are_the_kernels() -> None:
    one, other = socket.socketpair()
    with one, other:
        peer = peer_of(one)
    assert peer.uid == os.geteuid()
    assert peer.groups == {os.getegid(), *os.getgroups()}
    own, root = PeerCredentials(os.geteuid(), frozenset()), PeerCredentials(0, frozenset())
    stranger = PeerCredentials(os.geteuid() + 1, frozenset({7, 8}))
    assert is_authorized(own, None)
    assert is_authorized(root, None)
    assert not is_authorized(stranger, None)
    assert not is_authorized(stranger, 9)
    assert is_authorized(stranger, 8)
