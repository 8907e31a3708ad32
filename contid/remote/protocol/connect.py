"""Connecting to a daemon: waits for a place in its backlog, and checks whose socket it is.

Any user may create a folder or a socket below the system's temporary folder. A client therefore trusts the
credentials that the kernel reports for the listener: its own user, root, or the owner of the socket's folder
where others cannot write, as in ``/run/contid``.
"""

from __future__ import annotations

import os
import socket
import stat
import struct
import tempfile
from pathlib import Path

from contid.remote.protocol.peer_credentials import peer_of
from contid.remote.protocol.wire import NoDaemonError


def default_directory() -> Path:
    """The folder of this user's sockets; it may not exist yet."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime:
        return Path(runtime) / "contid"
    return Path(tempfile.gettempdir()) / f"contid-{os.geteuid()}"


def connect(path: Path, timeout_s: float | None = None) -> socket.socket:
    """A connection; a blocking one, which waits while the backlog is full, where a time is given.

    Raises:
        OSError: nothing listens there; BlockingIOError when the backlog is, or stayed full.
        NoDaemonError: another user listens there.
    """
    connected = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        if timeout_s is None:
            connected.setblocking(False)
        else:
            # With this option the call waits for room; after `settimeout` a full backlog fails at once.
            whole_s, rest_s = divmod(max(timeout_s, 0.001), 1.0)
            limit = struct.pack("@ll", int(whole_s), int(rest_s * 1e6))
            connected.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
        connected.connect(str(path))
        check_listener(path, connected)
    except BaseException:
        connected.close()
        raise
    return connected


def check_listener(path: Path, connected: socket.socket) -> None:
    """Refuse a socket of another user.

    Raises:
        NoDaemonError: with the user and the remedy.
    """
    uid = peer_of(connected).uid
    if uid in (os.geteuid(), 0):
        return
    folder = path.resolve().parent
    found = folder.stat()
    if (
        found.st_uid != uid
        or found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        or folder == default_directory().resolve()
    ):
        message = f"{path}: user {uid} listens there, neither you nor the owner of a protected folder"
        raise NoDaemonError(f"{message}; nothing was sent. Start the daemon as your user, or as a service")
