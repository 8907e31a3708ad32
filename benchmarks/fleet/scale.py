"""Many nodes on one bridge: latency of telemetry, processor time, and stops.

    python -m benchmarks.fleet.scale [--seconds 10]

The bridge is the real one, in a process of its own, and so is the watcher. The nodes are sockets with the
protocol of a daemon, all in one process: 32 daemons need more processors than most machines have. They send
lines of telemetry of a real daemon with two fingers. Measured for 1 and 8 nodes at 200 Hz and 32 at 20 Hz:
from the writing of a line to its arrival at the watcher, beside the same to a client of the socket itself in
the same run; processor time of the bridge per node; a stop of all nodes until the last answer; and what a
stop reports of nodes that stand still.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import os
import signal
import socket
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

import psutil

from benchmarks.on_sigterm import leave_on_sigterm
from contid.remote.protocol.wire import PROTOCOL, encode
from contid_fleet.fleet_file import OperatorFile
from contid_fleet.operator import FleetOperator
from contid_fleet.stops import stop_fleet
from tests.support.daemons import armed, daemon
from tests.support.fleets import bridge
from tests.support.waiting import until

STOPS: Final = 20


def frame_of_a_daemon() -> dict[str, Any]:
    """Telemetry of a real daemon with two fingers."""
    with daemon(2) as node, node.client() as client:
        armed(client)
        frames = client.telemetry(20.0)
        frame = dict(next(iter(frames)))
        frames.close()
    return {"event": "telemetry", **frame}


class Nodes:
    """Sockets that answer as a daemon does, and write lines at the rate that is asked for."""

    def __init__(self, folder: Path, count: int, frame: dict[str, Any]) -> None:
        self._paths = [folder / f"n{number}" for number in range(count)]
        self._frame = frame

    async def run(self, ready: Connection) -> None:
        """Serve until the process is ended."""
        servers = [await asyncio.start_unix_server(self._serve, path) for path in self._paths]
        ready.send(True)
        await asyncio.gather(*(server.serve_forever() for server in servers))

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(encode({"event": "hello", "protocol": PROTOCOL, "version": "0", "name": "n"}))
        tasks: set[asyncio.Task[None]] = set()
        with suppress(ConnectionError, asyncio.CancelledError):
            while line := await reader.readline():
                asked = json.loads(line)
                result: dict[str, Any] = {"tick": 1, "robots": {"f0": "OFF", "f1": "OFF"}, "client": 1}
                if asked["verb"] == "subscribe":
                    tasks.add(asyncio.create_task(self._publish(writer, float(asked["rate_hz"]))))
                writer.write(encode({"id": asked["id"], "ok": True, "result": result}))
        for task in tasks:
            task.cancel()
        writer.close()

    async def _publish(self, writer: asyncio.StreamWriter, rate_hz: float) -> None:
        next_s = time.monotonic()
        while not writer.is_closing():
            next_s = max(next_s + 1.0 / rate_hz, time.monotonic())
            await asyncio.sleep(next_s - time.monotonic())
            self._frame["t_s"] = time.monotonic()
            writer.write(encode(self._frame))


def _nodes(folder: Path, count: int, frame: dict[str, Any], ready: Connection) -> None:
    asyncio.run(Nodes(folder, count, frame).run(ready))


def _watch(endpoint: str, seconds: float, out: Connection) -> None:
    """Latencies of every line that comes through the bridge [s]."""
    found: list[float] = []
    with FleetOperator(OperatorFile(fleet="lab", operator="bob", connect=[endpoint])) as operator:
        until(operator.nodes, "a node is there")
        key = operator.keys.telemetry("*")
        operator.net.subscribe(key, lambda _, line: found.append(time.monotonic() - json.loads(line)["t_s"]))
        time.sleep(seconds)
    out.send(found)


def _read(path: Path, rate_hz: float, seconds: float, out: Connection) -> None:
    """The same of a client of one socket."""
    found: list[float] = []
    with socket.socket(socket.AF_UNIX) as connected:
        connected.connect(str(path))
        lines = connected.makefile("rb")
        connected.sendall(encode({"id": 1, "verb": "subscribe", "rate_hz": rate_hz}))
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            line = lines.readline()
            if line.startswith(b'{"event":"telemetry"'):
                found.append(time.monotonic() - json.loads(line)["t_s"])
    out.send(found)


def _percentile(values: Sequence[float], share: float) -> float:
    return sorted(values)[min(int(share * len(values)), len(values) - 1)]


def _row(what: str, values: Sequence[float]) -> str:
    return (
        f"  {what}: {len(values)} lines, p50 {_percentile(values, 0.5) * 1e3:.2f} ms, "
        f"p99 {_percentile(values, 0.99) * 1e3:.2f} ms"
    )


def measure(count: int, rate_hz: float, seconds: float, frame: dict[str, Any]) -> None:
    """One number of nodes at one rate; prints."""
    spawn = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory(prefix="contid-") as name:
        folder = Path(name)
        ready, far = spawn.Pipe(False)
        served = spawn.Process(target=_nodes, args=(folder, count, frame, far), daemon=True)
        served.start()
        ready.recv()
        sockets = {f"n{number}": folder / f"n{number}" for number in range(count)}
        try:
            with bridge(sockets, telemetry_hz=rate_hz) as begun:
                process = psutil.Process(begun.process.pid)
                (watched, one), (direct, two) = spawn.Pipe(False), spawn.Pipe(False)
                programs = [
                    spawn.Process(target=_watch, args=(begun.endpoint, seconds + 2.0, one)),
                    spawn.Process(target=_read, args=(folder / "n0", rate_hz, seconds + 2.0, two)),
                ]
                for program in programs:
                    program.start()
                time.sleep(2.0)
                before, begin_s = process.cpu_times(), time.monotonic()
                time.sleep(seconds)
                after, took_s = process.cpu_times(), time.monotonic() - begin_s
                through, beside = watched.recv(), direct.recv()
                for program in programs:
                    program.join()
                share = (after.user + after.system - before.user - before.system) / took_s
                print(f"{count} nodes at {rate_hz:g} Hz, load {os.getloadavg()[0]:.0f}")
                print(_row("to a watcher through the bridge", through))
                print(_row("to a client of one socket", beside))
                p50, p99 = (_percentile(through, s) / _percentile(beside, s) for s in (0.5, 0.99))
                print(f"  ratio: p50 {p50:.2f}, p99 {p99:.2f}")
                print(f"  processor time of the bridge: {share:.1%} of a core, {share / count:.2%} per node")
                _stops(begun.operator("anna", [*sockets]), served, count)
        finally:
            served.kill()
            served.join()


def _stops(file: OperatorFile, served: Any, count: int) -> None:
    with FleetOperator(file) as operator:
        until(lambda: len(operator.nodes()) == count, "every node is there")
        took: list[float] = []
        for _ in range(STOPS):
            report = stop_fleet(operator, "estop")
            assert report.complete, report
            took.append(report.took_s)
        median_ms, worst_ms = statistics.median(took) * 1e3, max(took) * 1e3
        print(
            f"  estop, last of {count} answers: median {median_ms:.1f} ms, worst of {STOPS} {worst_ms:.1f} ms"
        )
        os.kill(served.pid, signal.SIGSTOP)
        begin_s = time.monotonic()
        report = stop_fleet(operator, "estop")
        took_s = time.monotonic() - begin_s
        os.kill(served.pid, signal.SIGCONT)
        print(f"  nodes that stand still: {len(report.missing)} of {count} named after {took_s:.2f} s")
        assert not report.complete
        assert len(report.missing) + len(report.refused) == count


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    frame = frame_of_a_daemon()
    for count, rate_hz in ((1, 200.0), (8, 200.0), (32, 20.0)):
        measure(count, rate_hz, options.seconds, frame)
    return 0


if __name__ == "__main__":
    leave_on_sigterm()
    sys.exit(main())
