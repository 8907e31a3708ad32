"""Frames of a Vicon UDP object stream with local times of capture."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import Final

from contid_mocap.byte_reader import PacketError
from contid_mocap.clock import LeastLatency
from contid_mocap.datagrams import Datagram, open_socket, receive
from contid_mocap.room import RoomFrame, RoomPose
from contid_mocap.vicon.packet import PORT, ViconPacket, read_packet

#: An object whose numbers are equal to the last bit in this number of frames is held, not measured.
FROZEN: Final = 3
#: A frame number that goes back further than this belongs to a stream that began again.
_REORDERED: Final = 1000
_WRAP: Final = 1 << 32


@dataclass(frozen=True, slots=True)
class ViconSource:
    """Where the stream comes from, and what it does not carry itself.

    Attributes:
        server: address of the machine that sends.
        local: address of this machine that it sends to; 0.0.0.0 for broadcasts.
        port: that it sends to.
        rate_hz: frames per second; None when the time of arrival counts.
        latency_s: from the capture to the arrival of the fastest frames.
        fixed_axes: angles turn about the axes of the room.
    """

    server: IPv4Address
    local: IPv4Address
    port: int = PORT
    rate_hz: float | None = None
    latency_s: float = 0.0
    fixed_axes: bool = False


class ViconStream:
    """Frames of a stream.

    Args:
        source: addresses, rate and latency.

    Raises:
        DeviceNotFoundError: no socket at that address.
    """

    def __init__(self, source: ViconSource) -> None:
        self._source = source
        self._socket = open_socket(source.local, source.port)
        self._least = LeastLatency()
        self._wrong: Counter[str] = Counter()
        self._packets = 0
        self._number: int | None = None
        self._same: dict[str, tuple[RoomPose, int, int]] = {}

    def poll(self, timeout_s: float) -> list[RoomFrame]:
        """Frames that have arrived; of one that takes several packets, its parts."""
        frames = []
        for _, datagram in receive([self._socket], self._source.server, timeout_s):
            self._packets += 1
            try:
                packet = read_packet(datagram.data, self._source.fixed_axes)
            except PacketError as error:
                self._wrong[str(error)] += 1
                continue
            frames.append(self._placed(packet, datagram))
        return frames

    def restart(self) -> None:
        """Forget the frames of a stream that has begun again."""
        self._least.clear()
        self._number = None
        self._same.clear()

    def names(self) -> list[str]:
        """Objects that were in the stream."""
        return list(self._same)

    def facts(self) -> list[str]:
        """Packets, the time that counts, and packets that could not be read."""
        source = self._source
        time = "of arrival" if source.rate_hz is None else f"by {source.rate_hz:g} frames a second"
        lines = [f"Vicon at {source.server}: {self._packets} packets at port {source.port}, times {time}"]
        return lines + [f"  {count} packets not read: {text}" for text, count in self._wrong.most_common(5)]

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _placed(self, packet: ViconPacket, datagram: Datagram) -> RoomFrame:
        poses = {name: self._moving(name, pose, packet.number) for name, pose in packet.poses.items()}
        return RoomFrame(packet.number, self._captured_s(packet, datagram), datagram.received_s, poses)

    def _captured_s(self, packet: ViconPacket, datagram: Datagram) -> float:
        """The local time of the capture: by the number of the frame, or of arrival."""
        rate_hz = self._source.rate_hz
        if rate_hz is None:
            return datagram.received_s - self._source.latency_s
        # Counted on from the first frame, through the wrap of 32 bits.
        last = packet.number if self._number is None else self._number
        step = (packet.number - last + _WRAP // 2) % _WRAP - _WRAP // 2
        if step < -_REORDERED:
            self.restart()
            last, step = packet.number, 0
        if step >= 0:
            self._number = last + step
        return self._least.local_s((last + step) / rate_hz, datagram.received_s) - self._source.latency_s

    def _moving(self, name: str, pose: RoomPose | None, number: int) -> RoomPose | None:
        """A pose, or None while it is held: a measured one has noise in its last bits."""
        if pose is None:
            return None
        last = self._same.get(name)
        same = last is not None and last[0].position_m == pose.position_m and _turned_alike(last[0], pose)
        count = 1 if last is None or not same else last[1] + (number != last[2])
        self._same[name] = (pose, count, number)
        return None if count >= FROZEN else pose


def _turned_alike(a: RoomPose, b: RoomPose) -> bool:
    """True when the rotations are equal to the last bit."""
    if a.rotation is None or b.rotation is None:
        return a.rotation is b.rotation
    return bool((a.rotation == b.rotation).all())
