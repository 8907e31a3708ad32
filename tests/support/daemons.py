"""Real daemons on simulated devices for the tests of the socket."""

from __future__ import annotations

import json
import shutil
import signal
import socket as sockets
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from contid.client import Client
from contid.remote.protocol.connect import connect
from contid.remote.protocol.socket_path import is_listening
from contid.robot_file.load import configs_folder
from tests.support.fingers import fingers
from tests.support.waiting import until

#: Two points that a finger reaches.
HERE = {"x_mm": 50.0, "y_mm": 75.0}
FAR = {"x_mm": 30.0, "y_mm": 85.0}
#: A machine of CI can stand still for longer than the watchdogs of a real robot allow; a test of stalls
#: gives its own.
WATCHDOG = "watchdog_ms: 2000"
#: Ticks of a robot that stands still are most of what a test of the socket costs: 0.17 s of a processor each
#: second at 200 Hz with two fingers.
RATE_HZ = 100
#: What a daemon of a whole module prints, which is read at its end.
PIPE_BYTES = 1 << 20
#: Where fingers are when they have started.
START = {"left_mm": 50.0, "right_mm": 50.0}


@dataclass
class Running:
    """A daemon, its socket, and the journal of its devices."""

    process: subprocess.Popen[str]
    socket: Path
    folder: Path

    def client(self, **keys: Any) -> Client:
        return Client(self.socket, **keys)

    def journal(self) -> list[dict[str, Any]]:
        path = self.folder / "journal.jsonl"
        return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []

    def off(self) -> bool:
        """Every device is without torque."""
        lines = self.journal()
        return bool(lines) and not any(axis["on"] for axis in lines[-1]["axes"].values())

    def end(self, expected: int | None = 130) -> str:
        """End it orderly; returns its messages."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        _, output = self.process.communicate(timeout=30)
        if expected is not None:
            assert self.process.returncode == expected, output
        return output


@contextmanager
def daemon(
    count: int = 1,
    *arguments: str,
    options: str = "",
    stdin: str | None = None,
    change: Callable[[str], str] = str,
    prefix: Sequence[str] = (),
    rate_hz: int = RATE_HZ,
    **keys: Any,
) -> Iterator[Running]:
    """`contid run` that answers on its socket; every robot holds. ``change`` edits the robot file."""
    # Short: the path of a socket has 107 bytes.
    folder = Path(tempfile.mkdtemp(prefix="contid-"))
    robot = folder / "fingers.yaml"
    watchdog = "" if "watchdog_ms" in options else WATCHDOG
    journal = f"journal_file: {folder / 'journal.jsonl'}"
    text = fingers(count, options="\n".join([journal, watchdog, options]), rate_hz=rate_hz, **keys)
    robot.write_text(change(text))
    own = ("--socket", str(folder / "s"), "--recordings", str(folder), "--json")
    process = subprocess.Popen(
        [*prefix, *command("run", str(robot), *own, *arguments)],
        stdin=subprocess.DEVNULL if stdin is None else subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        pipesize=PIPE_BYTES,
    )
    if stdin is not None:
        assert process.stdin is not None
        process.stdin.write(stdin)
        process.stdin.close()
        process.stdin = None
    try:
        with listening(process, folder) as running:
            yield running
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def listening(process: subprocess.Popen[str], folder: Path) -> Iterator[Running]:
    """A daemon that was started with the socket ``s`` in a folder, once it listens; killed at the end."""
    running = Running(process, folder / "s", folder)
    try:
        until(lambda: is_listening(running.socket) or process.poll() is not None, "the daemon listens")
        assert process.poll() is None, process.communicate()[1]
        yield running
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


#: For tests that judge single ticks or what happens within a few hundredths of a second.
fast_daemon = partial(daemon, rate_hz=200)


def armed(client: Client) -> None:
    """Wait until every robot holds or runs."""
    until(
        lambda: {r["state"] for r in client.status()["robots"].values()} <= {"HOLD", "RUN", "APPROACH"},
        "every robot is armed",
    )


@contextmanager
def armed_daemon(count: int = 1, **keys: Any) -> Iterator[Running]:
    """A daemon whose robots are armed and hold."""
    with daemon(count, **keys) as started:
        with started.client() as client:
            armed(client)
        yield started


def as_started(running: Running) -> None:
    """Bring a daemon that other tests have used to where `armed_daemon` had it: by its own orders."""
    with running.client(name="next test") as client:
        client.acquire(20.0, takeover=True)
        before = client.status()["robots"]
        if any(robot["state"] == "FAULT" for robot in before.values()):
            client.clear_fault()
        if any(robot["state"] != "HOLD" for robot in before.values()):
            client.hold()
            client.resume(after_stop=True)
        client.move({f"{robot}.{column}": value for robot in before for column, value in START.items()})
        if client.status()["recordings"]:
            client.record(end=True)
        client.release()
        until(lambda: states(client) == {"HOLD"}, "every robot holds")
    for poses in running.folder.glob("*.poses.yaml"):
        poses.unlink()


def command(*arguments: str) -> Sequence[str]:
    return [sys.executable, "-m", "contid", *arguments]


def raw(running: Running) -> sockets.socket:
    connected = connect(running.socket, 20.0)  # waits while the backlog is full
    connected.settimeout(20.0)
    return connected


def states(client: Client) -> set[str]:
    return {robot["state"] for robot in client.status()["robots"].values()}


def arrives(client: Client, robot: str, tip_mm: tuple[float, ...]) -> None:
    """A move ends when the command is there; the simulated servo lags behind it."""
    until(lambda: client.status()["robots"][robot]["tip_mm"] == pytest.approx(tip_mm, abs=0.5), "it is there")


SHIPPED = sorted(path.stem for path in configs_folder().glob("*.yaml") if "." not in path.stem)
#: What no robot can move alone from rest. The tip of one section stays on a surface that is level there; two
#: tendons bend in a plane; and a tendon that is pulled alone makes the others slack.
TENDONS = [f"arm s{section}.t{tendon}_mm" for section in (1, 2, 3) for tendon in (1, 2, 3)]
BLOCKED = {
    "bend1": ["arm z_mm"], "catheter": ["arm z_mm"], "planar2": ["arm y_mm"],
    "tendon3": TENDONS, "ftdcr_v4": TENDONS,
}  # fmt: skip


@contextmanager
def shipped(name: str) -> Iterator[Running]:
    """`contid run NAME --mock`, armed, at rest."""
    folder = Path(tempfile.mkdtemp(prefix="contid-"))
    process = subprocess.Popen(
        command(
            "run",
            name,
            "--mock",
            "--rate",
            "50",
            "--socket",
            str(folder / "s"),
            "--recordings",
            str(folder),
        ),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with listening(process, folder) as running:
        with running.client() as client:
            armed(client)
        yield running
