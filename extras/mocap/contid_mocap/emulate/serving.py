"""The loop of an emulated server: frames at their rate, requests and lines in between."""

from __future__ import annotations

import os
import random
import select
import socket
import sys
import time
from dataclasses import dataclass
from typing import Protocol

from contid_mocap.emulate.scene import EmulatedScene


@dataclass(frozen=True, slots=True)
class Faults:
    """What goes wrong.

    Attributes:
        loss: share of the frames that are not sent.
        delay_s: from the exposure to the transmission.
        echo: echo requests are answered.
    """

    loss: float = 0.0
    delay_s: float = 0.0
    echo: bool = True


class EmulatedServer(Protocol):
    """A server, which sends one frame a call."""

    socket: socket.socket

    def answer(self) -> None:
        """Answer requests that have arrived."""

    def send_frame(self, number: int, exposed_s: float) -> None:
        """Send a frame that was exposed at a time of `time.monotonic`."""


def serve(server: EmulatedServer, scene: EmulatedScene, rate_hz: float, faults: Faults, poses: bool) -> None:
    """Serve until stdin ends, where poses come from there, or until a signal."""
    rng = random.Random(1)
    begun_s = time.monotonic()
    number = 0
    text = b""
    while True:
        next_s = begun_s + number / rate_hz + faults.delay_s
        waiting = [server.socket, *([sys.stdin] if poses else [])]
        ready, _, _ = select.select(waiting, [], [], max(next_s - time.monotonic(), 0.0))
        if server.socket in ready:
            server.answer()
        if sys.stdin in ready:
            read = os.read(sys.stdin.fileno(), 65536)
            if not read:
                return
            *lines, text = (text + read).split(b"\n")
            for line in lines:
                scene.move(line.decode(errors="replace"))
        if time.monotonic() >= next_s:
            if rng.random() >= faults.loss:
                server.send_frame(number, next_s - faults.delay_s)
            number += 1
