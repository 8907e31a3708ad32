"""Soak test: hand, tri-rack and pneumatic arm in one daemon at 200 Hz for an hour, with injected failures.

``python -m benchmarks.soak [--minutes 60] [--keep FILE.mcap]``. Devices are emulated on pseudo terminals
(servos, and three boards that run the sketch itself), the daemon runs in real time and records. A live stream
moves every axis; once a minute the cable of one bus after the other is pulled for two seconds, and an
operator clears and resumes; clients come over the socket, subscribe, send rubbish and vanish; one viewer
after the other is killed. Printed: memory and descriptors of daemon, control process and recorder over time;
ticks run, late and skipped; faults against pulled cables; whether the session holds every tick; a verdict.
Exit 1 when memory or descriptors grow, a process was lost, a fault was missed, a robot did not come back, or
the session is not complete.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Final

import psutil

from benchmarks.flat import Look, look, slope_of
from benchmarks.on_sigterm import leave_on_sigterm
from benchmarks.soak_clients import ARMED, Clients, Operator, Stream
from benchmarks.soak_lab import VIEWER_S, robot_file
from contid.client import Client
from contid.errors import ContidError
from contid.robot_file.load import load_robot_file

#: Time limits of the start (devices, daemon, first motion) and of the end of the run with its session.
START_S: Final = 60.0
END_S: Final = 900.0
#: No cable is pulled in this time before the end.
AFTER_S: Final = 4.0
#: Period of the samples of the processes, and samples per line of the table.
LOOK_S: Final = 5.0
LOOKS_PER_LINE: Final = 12
COLUMNS: Final = ("tick", "skipped", "clients", "cables", "faults", "file MB")
#: Problems of the report that a soak brings about: a large session, and a robot that catches up with its
#: rows after its cable was plugged in again.
HARMLESS: Final = ("still being compacted", "the live rows outran its limits")
#: Sampled processes, by a module name in their command line.
PROCESSES: Final = {"control": "contid.control.process", "recorder": "contid.session.mcap_recorder"}


@contextlib.contextmanager
def part(*message: str, **keys: Any) -> Iterator[subprocess.Popen[str]]:
    """A part of the laboratory, ended with SIGINT if it is still there."""
    command = [sys.executable, "-m", "benchmarks.soak_lab", *message]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, **keys)
    try:
        yield child
    finally:
        if child.poll() is None:
            child.send_signal(signal.SIGINT)
            child.communicate(timeout=END_S)


def all_armed(path: Path) -> bool:
    """True when every robot of the daemon is armed."""
    with suppress(ContidError), Client(path) as client:
        return {robot["state"] for robot in client.status()["robots"].values()} <= ARMED
    return False


def family(daemon: psutil.Process) -> dict[str, psutil.Process]:
    """Daemon, control process, recorder."""
    found = {"daemon": daemon}
    for child in daemon.children(recursive=True):
        with suppress(psutil.NoSuchProcess):
            message = child.cmdline()
            found |= {name: child for name, module in PROCESSES.items() if module in message}
    return found


class Table:
    """Samples of the processes, and the lines of the report."""

    def __init__(self, members: dict[str, psutil.Process]) -> None:
        self.members = members
        self.looks: dict[str, list[Look]] = {name: [] for name in members}
        cells = "".join(f"{name + ' RSS/PSS/own MB, fds':>34}" for name in members)
        print(f"{'s':>6}{cells}" + "".join(f"{word:>9}" for word in COLUMNS))

    def look(self, t_s: float) -> None:
        """Look at every process; raises when one is gone."""
        for name, member in self.members.items():
            self.looks[name].append(look(member, t_s))

    def line(self, status: dict[str, Any], visits: int, operator: Operator, session: Path) -> None:
        """Print the newest looks."""
        cells = ""
        for looks in self.looks.values():
            seen = looks[-1]
            memory = "/".join(f"{kb / 1024:.2f}" for kb in (seen.rss_kb, seen.pss_kb, seen.own_kb))
            cells += f"{memory + f', {seen.descriptors:>3}':>34}"
        faults = sum(len(cable.faulted) for cable in operator.cables) + operator.others.total()
        size_mb = round(session.stat().st_size / 1e6, 1)
        rest = (status["tick"], status["skipped"], visits, len(operator.cables), faults, size_mb)
        t_s = self.looks["daemon"][-1].t_s
        print(f"{t_s:>6.0f}{cells}" + "".join(f"{cell:>9}" for cell in rest), flush=True)


def soak(minutes: float, every_s: float, viewer_s: float = VIEWER_S, keep: Path | None = None) -> int:
    """Run, print, judge, keep the session if asked to; returns the exit code."""
    seconds = minutes * 60.0
    look_s = min(LOOK_S, seconds / 24.0)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="contid-soak-")))
        (folder / "lab.yaml").write_text(robot_file(folder))
        loaded, path = load_robot_file(folder / "lab.yaml"), folder / "lab.sock"
        devices = stack.enter_context(part("devices", str(folder)))
        assert devices.stdout is not None
        assert devices.stdout.readline() == "ready\n"
        log = stack.enter_context((folder / "daemon.txt").open("w"))
        child = stack.enter_context(
            part("daemon", str(folder), str(viewer_s), stdin=subprocess.PIPE, stderr=log)
        )
        assert child.stdin is not None
        stream = Stream(child.stdin, loaded)
        stream.start()
        stack.callback(stream.stop)
        give_up_s = time.monotonic() + START_S
        while not all_armed(path):
            if child.poll() is not None or time.monotonic() > give_up_s:
                message = (folder / "daemon.txt").read_text()
                raise SystemExit(f"the laboratory did not come up:\n{message}")
            time.sleep(0.2)
        pulls = [at * every_s for at in range(1, int((seconds - AFTER_S) / every_s) + 1)]
        operator = Operator(folder, loaded, pulls)
        operator.start()
        clients = Clients(path)
        table = Table(family(psutil.Process(child.pid)))
        lost = ""
        try:
            watch(seconds, look_s, child, table, clients, operator, path)
        except psutil.NoSuchProcess as error:
            lost = str(error)
        finally:
            operator.stop()
            clients.close()
            stream.stop()
        child.send_signal(signal.SIGINT)
        out, _ = child.communicate(timeout=END_S)
        report = json.loads(out.splitlines()[-1])
        # The daemon waits two minutes for the session to become small, which may take longer.
        psutil.wait_procs([table.members["recorder"]], timeout=END_S)
        code = judge(table, report, operator, folder / "lab.mcap", lost)
        if keep is not None:
            shutil.move(folder / "lab.mcap", keep)
        return code


def watch(
    seconds: float,
    look_s: float,
    child: subprocess.Popen[str],
    table: Table,
    clients: Clients,
    operator: Operator,
    path: Path,
) -> None:
    """The time between begin and end: look, visit, print."""
    begin_s = next_look_s = next_visit_s = time.monotonic()
    looks = 0
    while (now_s := time.monotonic()) < begin_s + seconds and child.poll() is None:
        if now_s >= next_visit_s:
            next_visit_s = now_s + 1.0
            clients.visit()
        if now_s >= next_look_s:
            next_look_s = now_s + look_s
            table.look(now_s - begin_s)
            if looks % LOOKS_PER_LINE == 0:
                with suppress(ContidError), Client(path) as client:
                    table.line(client.status(), clients.visits, operator, path.with_name("lab.mcap"))
            looks += 1
        time.sleep(0.02)
    table.look(seconds)


def judge(table: Table, report: dict[str, Any], operator: Operator, session: Path, lost: str) -> int:
    """Print what came of it; 1 when anything is wrong."""
    ticks, late, skipped = (report[key] for key in ("ticks", "late", "skipped"))
    print(f"ticks: {ticks} run, {late} late ({late / ticks:.3%}), {skipped} skipped ({skipped / ticks:.3%})")
    print(f"lateness: {json.dumps(report['lateness'])}")
    cables = operator.cables
    seen = sum(cable.faulted == cable.robots for cable in cables)
    back = [cable.back_s for cable in cables if not math.isnan(cable.back_s)]
    slowest = f", the slowest {max(back):.1f} s after the plug" if back else ""
    print(f"cables pulled: {len(cables)}; seen by every robot of the bus: {seen}; back: {len(back)}{slowest}")
    print(f"other faults: {dict(operator.others) or 'none'}")
    print(f"viewers killed: {report['viewers_killed']}")
    command = [sys.executable, "-m", "contid", "session", "info", str(session), "--json"]
    info = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    complete = info["state"] == "clean" and info["ticks"] == ticks and not info["lost"]
    print(
        f"session: {info['bytes'] / 1e6:.1f} MB, {info['state']}, {info['ticks']} of {ticks} ticks, "
        f"{len(info['faults'])} faults"
    )
    slopes = {name: slope_of(looks) for name, looks in table.looks.items()}
    for name, slope in slopes.items():
        print(f"{name}: {slope}")
    wrong = [
        *(f"{name} grows" for name, slope in slopes.items() if not slope.flat),
        *([f"a process was lost: {lost}"] if lost else []),
        *([] if seen == len(cables) else ["a pulled cable was not seen"]),
        *([] if len(back) == len(cables) else ["a robot did not come back"]),
        *([] if complete else ["the session is not complete"]),
        *([] if report["viewers_killed"] else ["no viewer was killed"]),
        *(message for message in report["problems"] if not any(text in message for text in HARMLESS)),
    ]
    print("verdict: " + ("; ".join(wrong) if wrong else "memory and descriptors flat, nothing lost"))
    return 1 if wrong else 0


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--unplug-every", type=float, default=60.0, metavar="SECONDS")
    parser.add_argument("--keep", type=Path, metavar="FILE.mcap", help="where the session goes; else nowhere")
    asked = parser.parse_args()
    return soak(asked.minutes, asked.unplug_every, keep=asked.keep)


if __name__ == "__main__":
    leave_on_sigterm()
    sys.exit(main())
