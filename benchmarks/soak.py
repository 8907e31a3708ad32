"""Hours of a laboratory: hand, tri-rack and pneumatic arm in one daemon at 200 Hz, and everything failing.

``python -m benchmarks.soak [--minutes 60]``. The daemon runs in real time on simulated devices and records.
A live stream moves every axis; one bus after the other is unplugged for two seconds, once a minute; clients
come over the socket, subscribe, send rubbish and vanish. Printed: memory and descriptors of daemon, control
process and recorder over time, late and skipped ticks. Exit 1 when memory or descriptors grew, or a process
was lost.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import json
import math
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import psutil
import yaml

from benchmarks.lab import lab
from contid.control.daemon import Orders
from contid.control.messages import ClearFault, Resume
from contid.control.wiring import build_plans
from contid.description.load import LoadedFile, parse_robot_file, with_mock

RATE_HZ: Final = 200.0
#: After this share of the run caches are warm; growth counts from then on.
WARM: Final = 0.25
#: Memory may differ by this much between the warm state and the end [MB].
GROWTH_MB: Final = 8.0
#: Clients that are there at the moment, and sockets being accepted.
FEW_DESCRIPTORS: Final = 6
GONE_S: Final = 2.0


def robot_file(every_s: float, seconds: float) -> str:
    """The laboratory with simulated buses, one of which is lost in turn every so many seconds."""
    loaded = with_mock(lab(RATE_HZ))
    raw = yaml.safe_load(loaded.text)
    for bus in loaded.buses.values():
        raw["buses"][bus.name] = {"driver": "sim", "faults": []}
        for name, options in bus.axes:
            robot, axis = name.split(".", 1)
            given = raw["robots"][robot]["axes"][axis]
            for key in ("id", "channel", "power_up_deg", "homing", "calibration", "readback", "ceiling_bar"):
                given.pop(key, None)
            given |= {k: v for k, v in options.model_dump(mode="json").items() if v is not None}
    for number, name in zip(range(1, int(seconds / every_s) + 1), itertools.cycle(raw["buses"])):
        fault = {"at_s": number * every_s, "kind": "lost", "for_s": GONE_S}
        raw["buses"][name]["faults"].append(fault)
    for robot in raw["robots"].values():
        robot.pop("placeholder", None)
    return yaml.safe_dump(raw, sort_keys=False, default_flow_style=None)


class Operator:
    """Clears and resumes every second, as a person would after each plug that is back."""

    async def serve(self, orders: Orders) -> None:
        """See `contid.control.daemon.Commands`."""
        while True:
            await asyncio.sleep(1.0)
            orders.send(ClearFault())
            await asyncio.sleep(0.2)
            orders.send(Resume())


def daemon(folder: Path) -> int:
    """The process that is watched: the daemon as `contid run` starts it, with an operator."""
    from contid.control.run import RunRequest, run
    from contid.remote.place import Endpoint
    from contid.remote.server import SocketServer
    from contid.session.record import Recording

    endpoint = Endpoint(folder / "lab.sock", default=False)
    request = RunRequest(
        robot_file=str(folder / "lab.yaml"),
        on_end="hold",
        unreachable="nearest",
        commands=[Operator(), SocketServer(endpoint)],
        observers=[Recording(folder / "lab.mcap", {})],
    )
    try:
        report = run(request)
    finally:
        endpoint.close()
    print(json.dumps(report.as_dict()))
    return report.exit_code


class Clients:
    """Come, subscribe, and vanish without a word."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._open: list[socket.socket] = []
        self.visits = 0

    def visit(self) -> None:
        """One more; the oldest of three is gone, with whatever it did not read."""
        if not self._path.exists():
            return
        end = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._open.append(end)
        with suppress(OSError):
            end.connect(str(self._path))
            end.sendall(
                b'{"id": 1, "verb": "status"}\n{"id": 2, "verb": "subscribe", "rate_hz": 50}\nrubbish\n'
            )
            self.visits += 1
        while len(self._open) > 3:
            self._open.pop(0).close()

    def close(self) -> None:
        """Nobody is left."""
        for end in self._open:
            end.close()


@dataclass(frozen=True)
class Look:
    """At one minute: memory of daemon, control process and recorder [MB, own pages], their descriptors."""

    processes: int
    memory_mb: float
    descriptors: int


def look(process: psutil.Process) -> Look:
    """Look at the daemon and everything it started."""
    every = [process, *process.children(recursive=True)]
    memory = sum(each.memory_full_info().uss for each in every) / 2**20
    return Look(len(every), round(memory, 1), sum(each.num_fds() for each in every))


def header(loaded: LoadedFile) -> tuple[str, list[tuple[float, float]]]:
    """Columns of the stream, and for each its middle and how far it swings, in the columns' own units."""
    names, swings = [], []
    for plan in build_plans(loaded, RATE_HZ):
        for axis, limits in zip(plan.axis_names, plan.limits, strict=True):
            names.append(f"{plan.name}.{axis}_{plan.quantity.unit}")
            span = (limits.upper - limits.lower) * plan.quantity.per_si
            swings.append((0.5 * (limits.upper + limits.lower) * plan.quantity.per_si, 0.04 * span))
    return ",".join(names), swings


def soak(minutes: float, every_s: float) -> int:
    """Run, print, judge; returns the exit code."""
    seconds = minutes * 60.0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        text = robot_file(every_s, seconds)
        (folder / "lab.yaml").write_text(text)
        columns, swings = header(parse_robot_file(text, "lab.yaml"))
        command = [sys.executable, "-m", "benchmarks.soak", "--daemon", str(folder)]
        child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert child.stdin is not None
        process, clients, looks = psutil.Process(child.pid), Clients(folder / "lab.sock"), []
        print(
            f"{'s':>6}{'processes':>11}{'memory MB':>11}{'descriptors':>13}{'clients so far':>16}", flush=True
        )
        begin_s = time.monotonic()
        next_look_s = next_visit_s = begin_s + min(5.0, 0.2 * seconds)
        try:
            child.stdin.write(columns + "\n")
            while (now_s := time.monotonic()) < begin_s + seconds and child.poll() is None:
                angle = now_s - begin_s
                cells = (middle + swing * math.sin(angle + at) for at, (middle, swing) in enumerate(swings))
                child.stdin.write(",".join(f"{cell:.4f}" for cell in cells) + "\n")
                child.stdin.flush()
                if now_s >= next_visit_s:
                    next_visit_s = now_s + 1.0
                    clients.visit()
                if now_s >= next_look_s:
                    next_look_s = now_s + min(60.0, 0.1 * seconds)
                    seen = look(process)
                    looks.append(seen)
                    row = (
                        f"{seen.processes:>11}{seen.memory_mb:>11}{seen.descriptors:>13}{clients.visits:>16}"
                    )
                    print(f"{now_s - begin_s:>6.0f}{row}", flush=True)
                time.sleep(0.05)
        finally:
            clients.close()
            child.send_signal(signal.SIGINT)
            out, _ = child.communicate(timeout=60)
    report = json.loads(out.splitlines()[-1])
    told = {key: report[key] for key in ("ticks", "late", "skipped", "lateness", "problems") if key in report}
    print(json.dumps(told))
    return judge(looks, report)


def judge(looks: list[Look], report: dict[str, Any]) -> int:
    """1 when anything grew after the warm part of the run."""
    warm = looks[int(WARM * len(looks)) :]
    growth = warm[-1].memory_mb - warm[0].memory_mb
    descriptors = warm[-1].descriptors - warm[0].descriptors
    lost = any(each.processes != warm[0].processes for each in warm)
    print(f"growth: {growth:+.1f} MB, {descriptors:+d} descriptors; processes lost: {lost}")
    print(f"skipped: {100.0 * report['skipped'] / max(report['ticks'], 1):.3f} % of {report['ticks']} ticks")
    return 1 if growth > GROWTH_MB or descriptors > FEW_DESCRIPTORS or lost else 0


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--unplug-every", type=float, default=60.0, metavar="SECONDS")
    parser.add_argument("--daemon", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.daemon is not None:
        return daemon(asked.daemon)
    return soak(asked.minutes, asked.unplug_every)


if __name__ == "__main__":
    sys.exit(main())
