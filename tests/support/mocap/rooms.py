"""Emulated motion-capture rooms in processes of their own, and frames for the tests of the decoders."""

from __future__ import annotations

import json
import random
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from contid_mocap.emulate.natnet_packets import SentBody, SentFrame, SentMarker, SentTimes, Version
from tests.support.ports import free_port

VERSIONS: Sequence[Version] = ((3, 0), (3, 1), (4, 0), (4, 1))


class EmulatedRoom:
    """An emulated server: its port, and lines that move its bodies."""

    def __init__(self, process: subprocess.Popen[str], port: int) -> None:
        self.process, self.port = process, port

    def pose(self, poses: Mapping[str, Sequence[float] | None]) -> None:
        """Move bodies (position [m] and quaternion), None hides one."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(poses) + "\n")
        self.process.stdin.flush()


@contextmanager
def emulated_room(kind: str, *arguments: str, poses: bool = False) -> Iterator[EmulatedRoom]:
    """Run ``contid track emulate`` on the loopback address, from its ready message on."""
    port = free_port(socket.SOCK_DGRAM)
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "contid", "track", "emulate", kind, *arguments, "--port", str(port)),
            *(["--poses"] if poses else []),
        ],
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    assert process.stdin is not None
    try:
        assert "ready" in process.stderr.readline()
        yield EmulatedRoom(process, port)
    finally:
        process.kill()
        process.wait(10)
        process.stdin.close()
        process.stderr.close()


def setup_file(folder: Path, text: str) -> Path:
    """Write ``mocap.yaml``."""
    path = folder / "mocap.yaml"
    path.write_text(text)
    return path


def random_frame(rng: random.Random, version: Version) -> SentFrame:
    """A frame with something in every section."""

    def point() -> tuple[float, float, float]:
        return (rng.uniform(-5, 5), rng.uniform(-5, 5), rng.uniform(-5, 5))

    def body(number: int) -> SentBody:
        q = [rng.gauss(0, 1) for _ in range(4)]
        norm = sum(value * value for value in q) ** 0.5
        turn: Any = tuple(value / norm for value in q)
        return SentBody(number, point(), turn, rng.uniform(0, 1e-3), rng.choice([0, 1, 1, 1]))

    def marker() -> SentMarker:
        return SentMarker(
            rng.getrandbits(31), point(), 0.01, rng.choice([2, 3, 10, 18]), rng.uniform(0, 1e-3)
        )

    def channels() -> list[list[float]]:
        return [[rng.gauss(0, 1) for _ in range(rng.randrange(4))] for _ in range(rng.randrange(4))]

    numbers = rng.sample(range(1, 1000), rng.randrange(6))
    exposed = rng.getrandbits(50)
    return SentFrame(
        rng.getrandbits(31),
        SentTimes(rng.uniform(0, 1e5), exposed, exposed + 10, exposed + 20),
        sets=[(f"set{k}", [point() for _ in range(rng.randrange(5))]) for k in range(rng.randrange(4))],
        others=[point() for _ in range(rng.randrange(5))],
        bodies=[body(number) for number in numbers],
        skeletons=[
            (k, [body(k << 16 | m) for m in range(rng.randrange(4))]) for k in range(rng.randrange(3))
        ],
        labelled=[marker() for _ in range(rng.randrange(6))],
        assets=[(k, [body(m) for m in range(2)], [marker()]) for k in range(rng.randrange(3))],
        plates=[(k, channels()) for k in range(rng.randrange(3))],
        devices=[(k, channels()) for k in range(rng.randrange(3))],
        flags=rng.choice([0, 1, 2]),
        tag=rng.random() < 0.8,
    )
