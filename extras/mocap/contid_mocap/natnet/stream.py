"""A connection to a NatNet server: frames with names and local times of capture."""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import Final

from contid.errors import ContidError, DeviceNotFoundError
from contid.targets import Vec3
from contid_mocap.byte_reader import PacketError
from contid_mocap.clock import EchoClock, LeastLatency
from contid_mocap.datagrams import Datagram, open_socket, receive, send
from contid_mocap.natnet import messages
from contid_mocap.natnet.frame import NatNetFrame, read_frame
from contid_mocap.natnet.messages import MessageId, NatNetVersion, ServerInfo
from contid_mocap.natnet.models import NatNetModels, read_models
from contid_mocap.room import RoomFrame, RoomPose, usable_position

#: How long a server may take to answer the connection, and the pause between two requests [s].
ANSWER_S: Final = 3.0
REPEAT_S: Final = 0.25
KEEP_ALIVE_S: Final = 1.0
#: Pauses between echo requests: of the first ones, and later [s].
FIRST_ECHO_S: Final = 0.02
FIRST_ECHOES: Final = 20
ECHO_S: Final = 0.5
#: Without an answer to an echo after this time the least latency of the frames counts [s].
NO_ECHO_S: Final = 1.0
#: The names are requested again after this time, where a number has none [s].
MODELS_S: Final = 1.0
#: Without a frame for this time the connection is requested again [s].
SILENT_S: Final = 2.0


@dataclass(frozen=True, slots=True)
class NatNetAddresses:
    """Where the server is, and where it is listened to.

    Attributes:
        server: its address.
        local: address of this machine in the same network.
        command_port: of the server.
        multicast: group of the frames, None of a server that sends to each client.
        data_port: of the group; None for the one that the server states.
        version: of the frames; None for the newest that both have.
    """

    server: IPv4Address
    local: IPv4Address
    command_port: int = messages.COMMAND_PORT
    multicast: IPv4Address | None = None
    data_port: int | None = None
    version: NatNetVersion | None = None


class NatNetStream:
    """Frames of a server.

    Args:
        addresses: of the server and of this machine.

    Raises:
        DeviceNotFoundError: no answer, or no socket at that address.
        ContidError: a version or a way of sending that the server does not have.
    """

    def __init__(self, addresses: NatNetAddresses) -> None:
        self._to = addresses
        self._command = open_socket(addresses.local, 0)
        self._sockets = [self._command]
        self._clock, self._least = EchoClock(), LeastLatency()
        self._models = NatNetModels()
        self._unnamed = True
        self._wrong: Counter[str] = Counter()
        self._echoes = 0
        self._at_s = dict.fromkeys(("echo", "alive", "models", "frame", "connect"), -math.inf)
        try:
            self._info = self._connected()
            self._version = self._chosen()
            if addresses.multicast is not None:
                port = addresses.data_port or self._info.data_port
                self._sockets.append(open_socket(addresses.local, port, addresses.multicast))
        except BaseException:
            self.close()
            raise
        self._begun_s = self._at_s["frame"] = time.monotonic()

    def poll(self, timeout_s: float) -> list[RoomFrame]:
        """Frames that have arrived, and what the protocol needs in between."""
        self._ask(time.monotonic())
        frames = []
        for _, datagram in receive(self._sockets, self._to.server, min(timeout_s, FIRST_ECHO_S)):
            try:
                frame = self._read(datagram)
            except PacketError as error:
                self._wrong[str(error)] += 1
                continue
            if frame is not None:
                frames.append(frame)
        return frames

    def restart(self) -> None:
        """Forget the clock of a server that has started again."""
        self._clock, self._echoes, self._unnamed = EchoClock(), 0, True
        self._least.clear()
        self._begun_s = time.monotonic()

    def names(self) -> list[str]:
        """Rigid bodies, then markers as ``SET:MARKER``."""
        markers = [f"{name}:{marker}" for name, each in self._models.markers.items() for marker in each]
        return [*self._models.bodies.values(), *markers]

    def facts(self) -> list[str]:
        """Server, version, clock, and packets that could not be read."""
        major, minor = self._version
        bound_s = self._clock.bound_s(time.monotonic())
        clock = f"known to {1e3 * bound_s:.2f} ms by echoes" if bound_s < 1.0 else "by the least latency"
        lines = [
            f"{self._info.application} at {self._to.server}, NatNet {major}.{minor}; its clock is {clock}"
        ]
        if self._models.unknown is not None:
            lines.append(f"  names behind a definition of kind {self._models.unknown} were not read")
        return lines + [f"  {count} packets not read: {text}" for text, count in self._wrong.most_common(5)]

    def close(self) -> None:
        """Close the sockets; a server without multicast stops after some seconds without a sign of life."""
        for each in self._sockets:
            each.close()

    def _connected(self) -> ServerInfo:
        """The answer of the server."""
        end_s = time.monotonic() + ANSWER_S
        refusal = "does not answer"
        while time.monotonic() < end_s:
            self._send(messages.connect(self._to.version or messages.VERSIONS[-1]))
            for _, datagram in receive(self._sockets, self._to.server, REPEAT_S):
                try:
                    number, contents = messages.split(datagram.data)
                    if number == MessageId.SERVER_INFO:
                        return messages.read_server_info(contents)
                except PacketError as error:
                    refusal = str(error)
        remedy = (
            "Motive: Data Streaming on, Local Interface this network; the firewall passes UDP 1510 and 1511"
        )
        raise DeviceNotFoundError(f"{self._to.server}:{self._to.command_port}", f"NatNet {refusal}", remedy)

    def _chosen(self) -> NatNetVersion:
        """The version of the frames."""
        info, newest = self._info, messages.VERSIONS[-1]
        if (info.multicast is None) != (self._to.multicast is None):
            has = "sends to each client" if info.multicast is None else f"sends to the group {info.multicast}"
            remedy = "leave --multicast out" if info.multicast is None else f"--multicast {info.multicast}"
            raise ContidError(f"the server at {self._to.server} {has}: {remedy}")
        if (asked := self._to.version) is not None:
            if asked > info.version:
                has = f"{info.version[0]}.{info.version[1]}"
                raise ContidError(f"the server at {self._to.server} has NatNet {has}: leave --version out")
            return asked
        if info.version > newest and info.multicast is not None:
            raise ContidError(
                f"the server sends NatNet {info.version[0]}.{info.version[1]} to its group; 4.1 is the "
                "newest that is read: set it to unicast, where a client asks for 4.1, or to an older version"
            )
        return min(info.version, newest)

    def _ask(self, now_s: float) -> None:
        """Echoes, signs of life, names, and the connection of a silent server."""
        if now_s - self._at_s["echo"] >= (FIRST_ECHO_S if self._echoes < FIRST_ECHOES else ECHO_S):
            self._at_s["echo"], self._echoes = now_s, self._echoes + 1
            self._send(messages.echo_request(int(time.monotonic() * 1e9)))
        if now_s - self._at_s["alive"] >= KEEP_ALIVE_S and self._to.multicast is None:
            self._at_s["alive"] = now_s
            self._send(messages.keep_alive())
        if self._unnamed and now_s - self._at_s["models"] >= MODELS_S:
            self._at_s["models"] = now_s
            self._send(messages.request_models())
        if now_s - max(self._at_s["frame"], self._at_s["connect"]) >= SILENT_S:
            self._at_s["connect"] = now_s
            self._send(messages.connect(self._version))

    def _send(self, data: bytes) -> None:
        send(self._command, data, self._to.server, self._to.command_port)

    def _read(self, datagram: Datagram) -> RoomFrame | None:
        number, contents = messages.split(datagram.data)
        if number == MessageId.FRAME:
            frame = read_frame(contents, self._version)
            self._at_s["frame"] = datagram.received_s
            self._unnamed |= frame.models_changed
            return self._placed(frame, datagram.received_s)
        if number == MessageId.MODELS:
            self._models, self._unnamed = read_models(contents, self._version), False
        elif number == MessageId.ECHO_RESPONSE:
            echo = messages.read_echo(contents)
            self._clock.echoed(echo.sent * 1e-9, datagram.received_s, echo.ticks / self._info.ticks_per_s)
        return None

    def _placed(self, frame: NatNetFrame, received_s: float) -> RoomFrame:
        """A frame with names and its local time of capture."""
        poses: dict[str, RoomPose | None] = {}
        for number, body in frame.bodies.items():
            name = self._models.bodies.get(number)
            # A number always works as a name; a number without a name may be a new body.
            self._unnamed |= name is None
            pose = None if body.position_m is None else RoomPose(body.position_m, body.rotation)
            poses[str(number)] = pose
            if name is not None:
                poses[name] = pose
        for name, points in frame.sets.items():
            # Of another length than defined: the definition is old.
            markers = self._models.markers.get(name, [])
            if len(markers) == len(points):
                poses |= {
                    f"{name}:{marker}": None if _lost(point, frame) else RoomPose(point, None)
                    for marker, point in zip(markers, points, strict=True)
                }
        return RoomFrame(frame.number, self._captured_s(frame, received_s), received_s, poses)

    def _captured_s(self, frame: NatNetFrame, received_s: float) -> float:
        """The local time of the middle of the exposure, where the server has none of the transmission."""
        per_s = self._info.ticks_per_s
        sent_s = self._least.local_s(frame.sent / per_s, received_s)
        ticks = frame.exposed or frame.sent
        if self._clock.fix is not None:
            return self._clock.local_s(ticks / per_s)
        if received_s - self._begun_s < NO_ECHO_S:
            return math.nan
        return sent_s + (ticks - frame.sent) / per_s


def _lost(point: Vec3, frame: NatNetFrame) -> bool:
    """True of a marker that no camera has seen: it stands at the origin, or is labelled so."""
    return not any(point) or point in frame.occluded or not usable_position(point)
