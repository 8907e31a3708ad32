"""An emulated NatNet server."""

from __future__ import annotations

import socket
import struct
import time
from typing import Final

from contid_mocap.emulate import natnet_packets as packets
from contid_mocap.emulate.natnet_packets import SentBody, SentFrame, SentMarker, SentTimes
from contid_mocap.emulate.scene import EmulatedScene
from contid_mocap.emulate.serving import Faults

#: Ticks of the performance counter of Windows, which differ from the clock here by an offset.
TICKS_PER_S: Final = 10_000_000
EPOCH_S: Final = 7_654.0
#: A client without a sign of life for this time gets no frames [s].
_ALIVE_S: Final = 5.0
#: Markers of a body, from its origin [m].
MARKERS: Final = {"Marker1": (0.01, 0.0, 0.0), "Marker2": (0.0, 0.01, 0.0), "Marker3": (0.0, 0.0, 0.01)}


class EmulatedNatNet:
    """A server.

    Args:
        address: and command port.
        version: of the protocol.
        scene: what it sees.
        faults: what goes wrong.
        group: multicast group and port, None to send to each client.
    """

    def __init__(
        self,
        address: tuple[str, int],
        version: packets.Version,
        scene: EmulatedScene,
        faults: Faults,
        group: tuple[str, int] | None = None,
    ) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(address)
        self.socket.setblocking(False)
        self._native = self._version = version
        self._scene, self._faults, self._group = scene, faults, group
        self._clients: dict[tuple[str, int], float] = {}
        if group is not None:
            self.socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(address[0]))

    def answer(self) -> None:
        """Answer requests that have arrived."""
        while True:
            try:
                data, client = self.socket.recvfrom(65535)
            except BlockingIOError:
                return
            if len(data) < 4:
                continue
            (kind,) = struct.unpack_from("<H", data)
            if kind == 0:
                self._connect(data, client)
            elif kind == 4:
                numbers = {k + 1: name for k, name in enumerate(self._scene.bodies)}
                sets = {name: list(MARKERS) for name in self._scene.bodies}
                self.socket.sendto(packets.models_packet(numbers, sets, self._version), client)
            elif kind == 10:
                self._clients[client] = time.monotonic()
            elif kind == 12 and self._faults.echo and len(data) >= 12:
                (sent,) = struct.unpack_from("<Q", data, 4)
                self.socket.sendto(packets.echo_packet(sent, _ticks(time.monotonic())), client)

    def send_frame(self, number: int, exposed_s: float) -> None:
        """Send a frame that was exposed at a time of `time.monotonic`."""
        now_s = time.monotonic()
        bodies, sets, labelled = [], [], []
        for k, (name, pose) in enumerate(self._scene.at(exposed_s).items()):
            if pose is None:
                bodies.append(SentBody(k + 1, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), flags=0))
                sets.append((name, [(0.0, 0.0, 0.0)] * len(MARKERS)))
                continue
            x, y, z, *turn = pose
            qx, qy, qz, qw = turn
            bodies.append(SentBody(k + 1, (x, y, z), (qx, qy, qz, qw), 1e-4))
            points = [(x + dx, y + dy, z + dz) for dx, dy, dz in MARKERS.values()]
            sets.append((name, points))
            labelled += [SentMarker((k + 1) << 16 | m + 1, point) for m, point in enumerate(points)]
        exposed, sent = _ticks(exposed_s), _ticks(now_s)
        times = SentTimes(now_s + EPOCH_S, exposed, sent, sent)
        frame = SentFrame(number, times, sets=sets, bodies=bodies, labelled=labelled)
        data = packets.frame_packet(frame, self._version)
        if self._group is not None:
            self.socket.sendto(data, self._group)
            return
        for client, alive_s in self._clients.items():
            if now_s - alive_s <= _ALIVE_S:
                self.socket.sendto(data, client)

    def _connect(self, data: bytes, client: tuple[str, int]) -> None:
        """State the properties; a client of its own gets the version that it asks for, from 4.0 on."""
        self._clients[client] = time.monotonic()
        # Behind the header: name, two versions, a flag, the version that is asked for.
        asked = (data[4 + 265], data[4 + 266]) if len(data) >= 4 + 269 else (0, 0)
        if self._group is None and self._native >= (4, 0) and (3, 0) <= asked <= self._native:
            self._version = asked
        group = None if self._group is None else socket.inet_aton(self._group[0])
        port = 1511 if self._group is None else self._group[1]
        self.socket.sendto(packets.server_packet(self._native, TICKS_PER_S, port, group), client)


def _ticks(local_s: float) -> int:
    """The server's clock at a local time."""
    return int((local_s + EPOCH_S) * TICKS_PER_S)
