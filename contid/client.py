"""Clients of a running daemon, for scripts and notebooks.

    from contid.client import Client

    with Client() as robot:                       # the only running daemon, or Client("PATH.sock")
        robot.resume()
        robot.move({"x_mm": 40, "y_mm": 75})      # returns when the tip is there
        for frame in robot.telemetry(rate_hz=20):
            print(frame["robots"])

`AsyncClient` is the same with ``await``. Needs only the standard library at run time.

A client never reconnects by itself: when the connection ends, every call raises `ConnectionLostError`, the
lease lapses and the robots hold. Make a new client and look at `status` first.
"""

from typing import Any

from contid.entry_points import LIBRARY, required
from contid.remote.client.servo import ServoReport, ServoState
from contid.remote.client.sync_client import Client
from contid.remote.protocol.wire import Code, ConnectionLostError, NoDaemonError, RemoteError

__all__ = [
    "AsyncClient",  # noqa: F822  # see __getattr__
    "Client",
    "Code",
    "ConnectionLostError",
    "NoDaemonError",
    "RemoteError",
    "ServoReport",
    "ServoState",
]


def __getattr__(name: str) -> Any:
    if name != "AsyncClient":
        raise AttributeError(f"module 'contid.client' has no attribute {name!r}")
    globals()[name] = required(LIBRARY, name, "contid.client.AsyncClient", "library")
    return globals()[name]
