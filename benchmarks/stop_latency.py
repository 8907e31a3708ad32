"""How long an emergency stop takes beside the worst clients: until it is obeyed, and until it is answered.

``python -m benchmarks.stop_latency [--stops 200]``. A daemon of `contid run finger --mock`, whose stdin is
flooded with rows and whose socket with everything at once: requests of 60 kB with thousands of unknown names,
cheap requests without a pause, subscribers at 200 Hz with different fields on the other places, and clients
that only connect, so that the backlog stays full. A third client, a connection of its own, sends estop, then
resumes. Obeyed: from sending to the deadline of the first tick whose state is OFF, by the recording.
Answered: to the response.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from benchmarks.stop_times import cells, obeyed_after
from contid.client import Client
from contid.errors import ContidError
from contid.session.read import Session

SUBSCRIBERS: Final = 64
HEAVY: Final = json.dumps({"id": 1, "verb": "move", "columns": [f"x_m{n}" for n in range(5500)]}).encode()
CHEAP: Final = b'{"id":1,"verb":"status"}\n' * 200
FIELDS: Final = ("state", "tip_mm", "error_mm", "command", "measured", "limits", "age_ms")


def sends(path: str, data: bytes) -> None:
    """Send data for ever; responses are thrown away."""
    while True:
        with suppress(OSError), socket.socket(socket.AF_UNIX) as end:
            end.connect(path)
            end.setblocking(False)
            left = memoryview(data)
            while True:
                with suppress(BlockingIOError):
                    left = left[end.send(left) :] or memoryview(data)
                with suppress(BlockingIOError):
                    if not end.recv(1 << 20):
                        break
                time.sleep(1e-4)


def heavy(path: str) -> None:
    """Requests that took 0.4 s each."""
    sends(path, HEAVY + b"\n")


def cheap(path: str) -> None:
    """Many small requests."""
    sends(path, CHEAP)


def subscribes(path: str) -> None:
    """Many subscribers, each with fields of its own."""
    ends = []
    for number in range(SUBSCRIBERS):
        end = socket.socket(socket.AF_UNIX)
        with suppress(OSError):
            end.connect(path)
            fields = [field for bit, field in enumerate(FIELDS) if (number + 1) >> bit & 1]
            end.sendall(
                json.dumps({"id": 1, "verb": "subscribe", "rate_hz": 200, "fields": fields}).encode() + b"\n"
            )
        end.setblocking(False)
        ends.append(end)
    while True:
        for end in ends:
            with suppress(OSError):
                end.recv(1 << 20)
        time.sleep(0.005)


def connects(path: str) -> None:
    """Connect and leave, without a pause."""
    while True:
        ends = [socket.socket(socket.AF_UNIX) for _ in range(32)]
        for end in ends:
            end.setblocking(False)
            with suppress(OSError):
                end.connect(path)
        time.sleep(0.01)
        for end in ends:
            end.close()


MIXES: Final[dict[str, Sequence[Callable[[str], None]]]] = {
    "no client": (),
    "heavy requests": (heavy, heavy),
    "subscribers": (subscribes,),
    "full backlog": (connects,),
    "all": (heavy, cheap, subscribes, connects),
}


def stops(path: Path, count: int) -> list[tuple[float, float]]:
    """When each stop was sent and answered [s]; a displaced client connects again."""
    out: list[tuple[float, float]] = []
    while len(out) < count:
        with suppress(ContidError), Client(path, name="third", timeout_s=30.0) as client:
            while len(out) < count:
                client.resume(after_stop=True)
                time.sleep(0.02)
                sent_s = time.monotonic()
                client.estop()
                out.append((sent_s, time.monotonic()))
    return out


def measure(name: str, count: int, flooded: bool) -> str:
    """One mix; a row of the table."""
    with tempfile.TemporaryDirectory(prefix="contid-") as folder:
        path, record = Path(folder, "s"), Path(folder, "r.mcap")
        # In a session of its own, as a service: there its nice value acts.
        own = "setsid " if flooded else ""
        run = f"exec {own}{sys.executable} -m contid run finger --mock --socket {path} --record {record} -q"
        feed = "(echo x_mm,y_mm; yes 50,75) | " if flooded else "< /dev/null "
        process = subprocess.Popen(
            f"{feed}{run}", shell=True, start_new_session=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        crowd = []
        try:
            while not path.exists():
                time.sleep(0.05)
            time.sleep(2.0)
            context = multiprocessing.get_context("spawn")
            crowd = [context.Process(target=kind, args=(str(path),), daemon=True) for kind in MIXES[name]]
            for each in crowd:
                each.start()
            time.sleep(1.0)
            sent = stops(path, count)
        finally:
            for each in crowd:
                each.kill()
            time.sleep(0.2)
            with suppress(ContidError), Client(path) as client:
                client.stop(end=True)
            with suppress(subprocess.TimeoutExpired):
                process.wait(20.0)
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
        session = Session(record)
        records = (entry.values for entry in session.entries() if entry.values is not None)
        obeyed = obeyed_after(records, session.layout, (at_s for at_s, _ in sent))
        answered = sorted(done_s - at_s for at_s, done_s in sent)
        row = [cell for values in (obeyed, answered) for cell in cells(values, (0.5, 0.99, 1.0), 1e3, 1)]
        return f"| {name} | {'flooded' if flooded else 'none'} | {' | '.join(row)} |"


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--stops", type=int, default=200)
    count = parser.parse_args().stops
    print(f"{count} stops each, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; ms")
    print("| clients | stdin | obeyed p50 | p99 | max | answered p50 | p99 | max |")
    print("|---|---|---|---|---|---|---|---|")
    for name in MIXES:
        for flooded in (False, True) if name in ("no client", "all") else (False,):
            print(measure(name, count, flooded), flush=True)


if __name__ == "__main__":
    main()
