"""An emulated Vicon UDP object stream."""

from __future__ import annotations

import math
import random
import socket

from contid_mocap.emulate.scene import EmulatedPose, EmulatedScene
from contid_mocap.emulate.vicon_packets import SentObject, object_packets

_LOST: SentObject = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class EmulatedVicon:
    """A stream.

    Args:
        address: that it sends from.
        to: address and port that it sends to.
        block: size of its packets.
        scene: what it sees.
    """

    def __init__(self, address: str, to: tuple[str, int], block: int, scene: EmulatedScene) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((address, 0))
        self.socket.setblocking(False)
        self._to, self._block, self._scene = to, block, scene
        self._rng = random.Random(1)

    def answer(self) -> None:
        """Drop what arrives: the stream takes no requests."""
        try:
            while True:
                self.socket.recv(65535)
        except (BlockingIOError, ConnectionRefusedError):
            return

    def send_frame(self, number: int, exposed_s: float) -> None:
        """Send a frame; its numbers have noise in their last digits, as measured ones."""
        objects: dict[str, SentObject] = {}
        for name, pose in self._scene.at(exposed_s).items():
            noise_mm = self._rng.gauss(0.0, 1e-4)
            objects[name] = _LOST if pose is None else _object(pose, noise_mm)
        for packet in object_packets(number, objects, self._block):
            try:
                self.socket.sendto(packet, self._to)
            except ConnectionRefusedError:
                continue  # nothing listens there yet


def _object(pose: EmulatedPose, noise_mm: float) -> SentObject:
    """Position [mm] and Euler angles of ``Rx Ry Rz``."""
    x, y, z, qx, qy, qz, qw = pose
    angle_y = math.asin(max(-1.0, min(1.0, 2.0 * (qx * qz + qy * qw))))
    angle_x = math.atan2(-2.0 * (qy * qz - qx * qw), 1.0 - 2.0 * (qx * qx + qy * qy))
    angle_z = math.atan2(-2.0 * (qx * qy - qz * qw), 1.0 - 2.0 * (qy * qy + qz * qz))
    return (1e3 * x + noise_mm, 1e3 * y, 1e3 * z, angle_x, angle_y, angle_z)
