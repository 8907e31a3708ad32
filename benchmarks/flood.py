"""Whether a client can delay a tick or block a stop: the hand at 200 Hz beside misbehaving clients.

``python -m benchmarks.flood [--rounds 4] [--seconds 8]``. In turn, round after round: no client; one that
floods requests and reads every answer; one that subscribes to everything at the highest rate and never reads;
one that sends garbage and reconnects when it is disconnected; one that acquires the lease, streams, and dies
by kill -9, again and again; a tracker that measures both fingers at 1 kHz. All the time another client stops
the robots (estop, stop, hold in turn) and resumes. Each run is `contid run hand --mock`, recorded; figures
are of the recorded ticks: how late they started, beside a bare loop that sleeps to the same deadlines in
another process at the same time, and how many ticks began between the moment the other client began to send
and the tick that obeyed, that one included.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from benchmarks import bare_loop
from contid.client import Client
from contid.errors import ContidError
from contid.session.read import Session

RATE_HZ: Final = 200.0
#: Life of a holder of the lease.
LIFE_S: Final = 0.6
#: Between two stops.
STOP_EVERY_S: Final = 0.5
STOPS: Final = ("estop", "stop", "hold")
#: Late by more than a tenth of the period, as everywhere.
LATE: Final = 0.1


def floods(path: str) -> None:
    """As many requests as the daemon takes; answers are read and thrown away."""
    with socket.socket(socket.AF_UNIX) as end:
        end.connect(path)
        end.setblocking(False)
        requests = memoryview(b'{"id":1,"verb":"status"}\n' * 200)
        left = requests
        while True:
            with suppress(BlockingIOError):
                left = left[end.send(left) :] or requests
            with suppress(BlockingIOError):
                end.recv(1 << 20)


def never_reads(path: str) -> None:
    """Everything, at the highest rate, into a socket that is never read."""
    fields = '"state","fault","tip_mm","target_mm","error_mm","command","measured","limits","age_ms"'
    asked = f'{{"id":1,"verb":"subscribe","rate_hz":200,"events":true,"fields":[{fields}]}}\n'.encode()
    while True:
        with socket.socket(socket.AF_UNIX) as end, suppress(OSError):
            end.connect(path)
            end.sendall(asked)
            while True:  # until it is disconnected
                end.sendall(b" \n")
                time.sleep(0.05)


def garbage(path: str) -> None:
    """Lines of noise; reconnects at once when it is disconnected."""
    noise = random.Random(1)
    while True:
        with socket.socket(socket.AF_UNIX) as end, suppress(OSError):
            end.connect(path)
            while True:
                end.sendall(noise.randbytes(4096) + b"\n")


def holds(path: str) -> None:
    """Takes the lease over and streams, until it is killed."""
    with Client(path, name="doomed") as client:
        client.acquire(2.0, takeover=True)
        client.resume()
        client.stream(["left.x_mm", "left.y_mm", "right.x_mm", "right.y_mm"], waving())


def measures(path: str) -> None:
    """A tracker of both fingers, a thousand poses a second, or as many as are answered."""
    with Client(path, name="tracker") as client:
        next_s = time.monotonic()
        while True:
            for robot, x_mm in (("left", 0.0), ("right", 100.0)):
                client.measure([x_mm, 75.0], direction=[0.0, 1.0], robot=robot, age_ms=2.0)
                next_s = max(next_s + 1e-3, time.monotonic() - 0.01)
                time.sleep(max(next_s - time.monotonic(), 0.0))


def waving() -> Iterator[tuple[float, float, float, float]]:
    """Rows for ever, a hundred a second."""
    step = 0
    while True:
        step += 1
        x = 0.02 * (step % 100)
        yield -10.0 + x, 70.0, 110.0 - x, 70.0
        time.sleep(0.01)


CLIENTS: Final[dict[str, Callable[[str], None] | None]] = {
    "no client": None,
    "floods requests": floods,
    "never reads": never_reads,
    "sends garbage": garbage,
    "holds and dies": holds,
    "measures, 1 kHz": measures,
}


@dataclass
class Seen:
    """Of one kind of client, over all rounds: lateness [s] of ticks and of the bare loop, stops."""

    ticks: list[float] = field(default_factory=list)
    bare: list[float] = field(default_factory=list)
    skipped: int = 0
    stop_ticks: list[int] = field(default_factory=list)
    stop_ms: list[float] = field(default_factory=list)
    clients: int = 0


@contextmanager
def child(*message: str, **keys: Any) -> Iterator[subprocess.Popen[str]]:
    """A process that is killed at the end."""
    process = subprocess.Popen([sys.executable, "-m", *message], text=True, **keys)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def run(kind: str, seconds: float, folder: Path, seen: Seen) -> None:
    """One run beside one kind of client."""
    path, session, table = folder / "s", folder / "run.mcap", folder / "circle.csv"
    session.unlink(missing_ok=True)
    own = ("contid", "run", "hand", "--mock", "--trajectory", str(table), "--on-end", "hold", "--json")
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    with child(*own, "--socket", str(path), "--record", str(session), **quiet) as daemon:
        await_there(path, {"RUN"})
        begin_s = time.monotonic()
        with bare_loop.started(seconds, RATE_HZ) as bare, Client(path, name="person") as person:
            stops = harass(kind, path, person, begin_s + seconds, seen)
            end_s = time.monotonic()
            seen.bare += bare_loop.read(bare)
        daemon.send_signal(signal.SIGINT)
        daemon.communicate(timeout=60)
    take(Session(session), begin_s, end_s, stops, seen)


def await_there(path: Path, states: set[str]) -> None:
    """Wait until every robot of a daemon is in one of these states."""
    give_up_s = time.monotonic() + 30.0
    while time.monotonic() < give_up_s:
        with suppress(ContidError), Client(path) as client:
            if {robot["state"] for robot in client.status()["robots"].values()} <= states:
                return
        time.sleep(0.05)
    raise SystemExit(f"the robots did not come to {states}")


def harass(kind: str, path: Path, person: Client, until_s: float, seen: Seen) -> list[tuple[float, int]]:
    """Let clients of a kind work while a person stops and resumes; when each stop was sent, and its tick."""
    message = ("benchmarks.flood", "--client", kind, str(path))
    stops: list[tuple[float, int]] = []
    process: subprocess.Popen[str] | None = None
    next_life_s, next_stop_s = 0.0, time.monotonic() + STOP_EVERY_S
    try:
        while time.monotonic() < until_s:
            if CLIENTS[kind] is not None and time.monotonic() >= next_life_s:
                if process is not None:
                    process.kill()
                    process.wait()
                process = subprocess.Popen(
                    [sys.executable, "-m", *message], stderr=subprocess.DEVNULL, text=True
                )
                seen.clients += 1
                next_life_s = time.monotonic() + (LIFE_S if kind == "holds and dies" else 1e9)
            if time.monotonic() >= next_stop_s:
                sent_s = time.monotonic()
                response = person.request(STOPS[len(stops) % len(STOPS)])
                seen.stop_ms.append((time.monotonic() - sent_s) * 1e3)
                stops.append((sent_s, int(response["tick"])))
                with suppress(ContidError):  # the other client may hold the lease
                    person.resume(wait=False)
                next_stop_s = time.monotonic() + STOP_EVERY_S
            time.sleep(0.002)
    finally:
        if process is not None:
            process.kill()
            process.wait()
    return stops


def take(session: Session, begin_s: float, end_s: float, stops: list[tuple[float, int]], seen: Seen) -> None:
    """Add the ticks and stops that the session holds between begin and end."""
    ticks = [tick for tick in session.ticks() if begin_s <= tick.deadline_s <= end_s]
    seen.ticks += [tick.lateness_s for tick in ticks]
    seen.skipped += ticks[-1].skipped - ticks[0].skipped
    for sent_s, obeyed in stops:
        after = next(tick.tick for tick in ticks if tick.deadline_s + tick.lateness_s > sent_s)
        seen.stop_ticks.append(obeyed - after + 1)


def shown(values: list[float]) -> str:
    """p50, p99, p99.9, greatest."""
    ordered = sorted(values)
    at = [ordered[min(int(share * len(ordered)), len(ordered) - 1)] for share in (0.5, 0.99, 0.999, 1.0)]
    return "".join(f"{1e6 * value:>8.0f}" for value in at)


def report(seen: dict[str, Seen]) -> None:
    """The table."""
    heads = "".join(f"{word:>8}" for word in ("p50", "p99", "p99.9", "max"))
    print(f"\n{'':<18}{'ticks':>7}{heads}{'late':>8}{'skipped':>9}  |{heads} bare loop [us]")
    for kind, each in seen.items():
        late = sum(value > LATE / RATE_HZ for value in each.ticks) / len(each.ticks)
        row = f"{shown(each.ticks)}{late:>8.2%}{each.skipped:>9}  |{shown(each.bare)}"
        print(f"{kind:<18}{len(each.ticks):>7}{row}")
    print(
        f"\n{'':<18}{'stops':>7}{'obeyed in tick, median':>24}{'greatest':>10}{'answered ms, median':>22}",
        end="",
    )
    print(f"{'greatest':>10}{'clients':>9}")
    for kind, each in seen.items():
        ticks, answers = sorted(each.stop_ticks), sorted(each.stop_ms)
        middle = len(ticks) // 2
        row = (
            f"{ticks[middle]:>24}{ticks[-1]:>10}{answers[middle]:>22.1f}{answers[-1]:>10.1f}{each.clients:>9}"
        )
        print(f"{kind:<18}{len(ticks):>7}{row}")


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.flood", description=__doc__)
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=8.0, help="of each kind in each round")
    parser.add_argument("--client", nargs=2, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.client is not None:
        work = CLIENTS[asked.client[0]]
        assert work is not None
        work(asked.client[1])
        return
    seen = {kind: Seen() for kind in CLIENTS}
    with tempfile.TemporaryDirectory(prefix="contid-") as name:
        folder = Path(name)
        path = [sys.executable, "-m", "contid", "path", "circle", "--center", "50,70", "--radius", "20"]
        laps = str(int(asked.seconds) + 20)
        made = subprocess.run([*path, "--laps", laps, "--for", "hand"], check=True, capture_output=True)
        (folder / "circle.csv").write_bytes(made.stdout)
        for number in range(asked.rounds):
            for kind in CLIENTS:
                run(kind, asked.seconds, folder, seen[kind])
            print(f"round {number + 1} of {asked.rounds}, load {os.getloadavg()[0]:.1f}", flush=True)
    report(seen)


if __name__ == "__main__":
    main()
