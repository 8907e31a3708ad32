"""How old a measured tip is when the daemon has it, from a motion-capture room at 240 Hz.

``python -m benchmarks.mocap [--seconds 20] [--rate-hz 240]``. An emulated NatNet server, a daemon of `contid
run finger --mock`, and the tracker, each in a process of its own on the loopback interface. The latency is
from the exposure of a frame until `measure` is sent; the emulated server sends at the exposure. Beside
it a bare receiver of the same server, which reads the datagram and the clock.
"""

from __future__ import annotations

import argparse
import multiprocessing
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from ipaddress import IPv4Address
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

from contid.client import Client
from contid.control.process.realtime import TRACKER, request_real_time
from contid.remote.protocol.socket_path import is_listening
from contid_mocap.emulate.natnet_server import EPOCH_S, TICKS_PER_S
from contid_mocap.follow import Follower, FollowReport, follow
from contid_mocap.natnet import messages
from contid_mocap.natnet.frame import read_frame
from contid_mocap.natnet.stream import NatNetAddresses, NatNetStream
from contid_mocap.sending import RoomTipSender
from contid_mocap.setup_file import MocapSetup, RoomPlace, TipPlace
from contid_mocap.tip_tracker import RoomTipTracker

PORT: Final = 15110
HERE: Final = IPv4Address("127.0.0.1")


def bare(seconds: float, results: Connection) -> None:
    """Receive frames and note their ages; decoding comes after all of them."""
    request_real_time(TRACKER)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind((str(HERE), 0))
        end.settimeout(1.0)
        seen: list[tuple[bytes, float]] = []
        stop_s = time.monotonic() + seconds
        alive_s = 0.0
        end.sendto(messages.connect((4, 1)), (str(HERE), PORT))
        while (now_s := time.monotonic()) < stop_s:
            if now_s > alive_s:
                alive_s = now_s + 1.0
                end.sendto(messages.keep_alive(), (str(HERE), PORT))
            data = end.recv(65535)
            seen.append((data, time.monotonic()))
    ages = []
    for data, at_s in seen:
        number, contents = messages.split(data)
        if number == messages.MessageId.FRAME:
            ages.append(at_s - (read_frame(contents, (4, 1)).exposed / TICKS_PER_S - EPOCH_S))
    results.send(ages)


def line(name: str, ages_s: Iterable[float]) -> str:
    """Percentiles in milliseconds."""
    ordered = sorted(ages_s)
    found = [1e3 * ordered[int(share * (len(ordered) - 1))] for share in (0.5, 0.99, 0.999, 1.0)]
    return f"{name:10} {len(ordered)} frames [ms]: " + ", ".join(
        f"{what} {value:.2f}" for what, value in zip(("p50", "p99", "p99.9", "max"), found, strict=True)
    )


def track(path: Path, seconds: float) -> FollowReport:
    """Track the emulated room into the daemon, as `contid track` does."""
    request_real_time(TRACKER)
    tip = TipPlace(body="tip", roll_deg=-90)
    setup = MocapSetup(contid_mocap=1, room=RoomPlace(up="z"), robots={"finger": tip})
    stream, report = NatNetStream(NatNetAddresses(HERE, HERE, PORT)), FollowReport()
    try:
        with Client(path, name="benchmark") as client:
            follow(
                stream,
                RoomTipTracker(setup),
                Follower(RoomTipSender(client, print), print, newest=True),
                report,
                seconds,
            )
    finally:
        stream.close()
    return report


def main() -> None:
    """Print both latencies."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rate-hz", type=float, default=240.0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "s"
        room = ["contid", "track", "emulate", "natnet", "tip=0.02,0.08,0", "plate", "--port", str(PORT)]
        server = subprocess.Popen(
            [sys.executable, "-m", *room, "--rate-hz", str(asked.rate_hz)], stderr=subprocess.PIPE, text=True
        )
        run = ["contid", "run", "finger", "--mock", "--socket", str(path), "-q"]
        daemon = subprocess.Popen(
            [sys.executable, "-m", *run], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, cwd=folder
        )
        try:
            assert server.stderr is not None
            server.stderr.readline()
            while not is_listening(path):
                time.sleep(0.05)
            time.sleep(1.0)
            here, there = multiprocessing.Pipe()
            receiver = multiprocessing.Process(target=bare, args=(asked.seconds, there))
            receiver.start()
            there.close()  # an end of the receiver without a result then ends this too
            report = track(path, asked.seconds)
            ages = here.recv()
            receiver.join()
        finally:
            for each in (server, daemon):
                each.terminate()
                each.wait(20)
    print(line("measure", report.latency_s))
    print(line("bare", ages))
    print(report)


if __name__ == "__main__":
    main()
