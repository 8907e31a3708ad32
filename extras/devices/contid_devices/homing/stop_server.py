"""The socket of a command that moves a robot without a daemon, such as ``contid home``.

It implements the part of the daemon's protocol that ``contid estop``, ``stop`` and ``hold`` need. Any client
may stop the command: that interrupts it like Ctrl-C; the response comes when the devices are at rest.
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
from contid.remote.protocol.socket_path import Endpoint, default_path
from contid.remote.protocol.wire import (
    ESTOP,
    PROTOCOL,
    STOP_VERBS,
    Code,
    Fields,
    RemoteError,
    decode,
    encode,
    is_estop,
)
from contid.units import MAX_LINE

#: Time for a client to read its responses.
_CLIENT_TIMEOUT_S: Final = 0.5
#: Time for the devices to come to rest.
_REST_TIMEOUT_S: Final = 5.0


class StopServer:
    """Context manager: orders to stop interrupt the main thread."""

    def __init__(self, robot_file: str, activity: str) -> None:
        """Listen at the default path of this robot file's daemon.

        Args:
            robot_file: path or name.
            activity: of the command, such as ``homing``, for the clients.

        Raises:
            SocketError: a daemon or another such command listens there already.
        """
        self._endpoint = Endpoint(default_path(robot_file), default=True)
        self._activity = activity
        self._at_rest = threading.Event()
        self._wake_r, self._wake_w = os.pipe()
        self._thread = threading.Thread(target=self._serve, name="contid-stop-server", daemon=True)

    def __enter__(self) -> Self:
        """Begin to serve."""
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """The devices are at rest: respond to the orders and stop listening."""
        self._at_rest.set()
        os.write(self._wake_w, b"!")
        self._thread.join(2.0 * _CLIENT_TIMEOUT_S)
        self._endpoint.close()
        os.close(self._wake_r)
        os.close(self._wake_w)

    def _serve(self) -> None:
        clients: dict[socket.socket, bytearray] = {}
        while not self._at_rest.is_set():
            watched: list[int | socket.socket] = [self._wake_r, self._endpoint.socket, *clients]
            for each in select.select(watched, [], [])[0]:
                if each is self._endpoint.socket:
                    with suppress(OSError):
                        client, _ = self._endpoint.socket.accept()
                        client.settimeout(_CLIENT_TIMEOUT_S)
                        clients[client] = bytearray()
                        client.sendall(encode({"event": "hello", **self._hello()}))
                elif isinstance(each, socket.socket) and not self._receive(each, clients[each]):
                    del clients[each]
                    each.close()
        for client in clients:
            client.close()

    def _hello(self) -> Fields:
        return {"protocol": PROTOCOL, "version": __version__, "name": self._activity}

    def _receive(self, client: socket.socket, buffer: bytearray) -> bool:
        """Serve the lines that came; False when the client disconnected or sent a line too long."""
        try:
            data = client.recv(MAX_LINE)
            buffer += data
            if not data and is_estop(bytes(buffer)):  # it left without an end of line
                buffer += b"\n"
            while (end := buffer.find(b"\n")) >= 0:
                line = bytes(buffer[: end + 1])
                del buffer[: end + 1]
                client.sendall(encode(self._response(line)))
        except OSError:
            return False
        return bool(data) and len(buffer) < MAX_LINE

    def _response(self, line: bytes) -> Fields:
        number = None
        try:
            try:
                fields = decode(line)
            except RemoteError:
                if is_estop(line):
                    self._stop()
                raise
            number = fields.get("id")
            verb = ESTOP if is_estop(line) else fields.get("verb")
            return {"id": number, "ok": True, "result": self._result(verb)}
        except RemoteError as error:
            return {"id": number, "ok": False, "error": error.as_fields()}

    def _result(self, verb: object) -> Fields:
        if verb in STOP_VERBS:
            return self._stop()
        if verb == "hello":
            return {**self._hello(), "client": 0}
        if verb == "ping":
            return {}
        message = f"a command is {self._activity} without a daemon; only {', '.join(STOP_VERBS)} are possible"
        raise RemoteError(Code.REFUSED, message)

    def _stop(self) -> Fields:
        os.kill(os.getpid(), signal.SIGINT)
        if not self._at_rest.wait(_REST_TIMEOUT_S):
            message = f"interrupted, but the devices have not come to rest within {_REST_TIMEOUT_S:g} s"
            raise RemoteError(Code.NO_ANSWER, message)
        return {"tick": 0, "robots": {}}
