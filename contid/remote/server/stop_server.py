"""The socket of a command that moves a robot by itself, such as ``contid home``: anybody may stop it there.

It speaks as much of the daemon's protocol as ``contid estop``, ``stop`` and ``hold`` need. An order to stop
interrupts the command as Ctrl-C does, and is answered when the devices are at rest.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import threading
from contextlib import suppress
from types import TracebackType
from typing import Final, Self

from contid import __version__
from contid.lines import MAX_LINE
from contid.remote.protocol.socket_path import Endpoint, default_path
from contid.remote.protocol.wire import PROTOCOL, Code, Fields, RemoteError, decode, encode

_STOPS: Final = ("estop", "stop", "hold")
#: How long a client may leave the answers to it unread, and how long the devices may take to come to rest.
_CLIENT_S: Final = 0.5
_REST_S: Final = 5.0


class StopServer:
    """Context manager: while it lasts, orders to stop interrupt the main thread."""

    def __init__(self, robot_file: str, doing: str) -> None:
        """Listen where the daemon of this robot file would.

        Args:
            robot_file: path or name.
            doing: what the others are told, such as ``homing``.

        Raises:
            SocketError: a daemon or another such command listens there already.
        """
        self._endpoint = Endpoint(default_path(robot_file), default=True)
        self._doing = doing
        self._resting = threading.Event()
        self._wake_r, self._wake_w = os.pipe()
        self._thread = threading.Thread(target=self._serve, name="contid-door", daemon=True)

    def __enter__(self) -> Self:
        """Begin to serve."""
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """The devices are at rest: say so to whoever asked for it, and listen no more."""
        self._resting.set()
        os.write(self._wake_w, b"!")
        self._thread.join(2.0 * _CLIENT_S)
        self._endpoint.close()
        os.close(self._wake_r)
        os.close(self._wake_w)

    def _serve(self) -> None:
        clients: dict[socket.socket, bytearray] = {}
        while not self._resting.is_set():
            watched: list[int | socket.socket] = [self._wake_r, self._endpoint.socket, *clients]
            for each in select.select(watched, [], [])[0]:
                if each is self._endpoint.socket:
                    with suppress(OSError):
                        client, _ = self._endpoint.socket.accept()
                        client.settimeout(_CLIENT_S)
                        clients[client] = bytearray()
                        client.sendall(encode({"event": "hello", **self._hello()}))
                elif isinstance(each, socket.socket) and not self._hear(each, clients[each]):
                    clients.pop(each).clear()
                    each.close()
        for client in clients:
            client.close()

    def _hello(self) -> Fields:
        return {"protocol": PROTOCOL, "version": __version__, "name": self._doing}

    def _hear(self, client: socket.socket, heard: bytearray) -> bool:
        """Serve the lines that came; False when the client is gone or talks garbage."""
        try:
            data = client.recv(MAX_LINE)
            heard += data
            while (end := heard.find(b"\n")) >= 0:
                line = bytes(heard[: end + 1])
                del heard[: end + 1]
                client.sendall(encode(self._answer(line)))
        except OSError:
            return False
        return bool(data) and len(heard) < MAX_LINE

    def _answer(self, line: bytes) -> Fields:
        number = None
        try:
            fields = decode(line)
            number = fields.get("id")
            verb = fields.get("verb")
            if verb in _STOPS:
                return {"id": number, "ok": True, "result": self._stop()}
            if verb == "hello":
                return {"id": number, "ok": True, "result": {**self._hello(), "client": 0}}
            if verb == "ping":
                return {"id": number, "ok": True, "result": {}}
            message = f"it is {self._doing}, by a command of its own; only {', '.join(_STOPS)} are possible"
            raise RemoteError(Code.REFUSED, message)
        except RemoteError as error:
            return {"id": number, "ok": False, "error": error.as_fields()}

    def _stop(self) -> Fields:
        os.kill(os.getpid(), signal.SIGINT)
        if not self._resting.wait(_REST_S):
            message = f"interrupted, but the devices have not come to rest within {_REST_S:g} s"
            raise RemoteError(Code.NO_ANSWER, message)
        return {"tick": 0, "robots": {}}
