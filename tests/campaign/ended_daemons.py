"""One daemon after the other, ended by SIGTERM: how long it took and what it left behind."""

from __future__ import annotations

import os
import pty
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

import psutil

from contid.client import Client
from contid.control.process.shared_files import folder as ring_folder
from contid.remote.protocol.socket_path import is_listening
from contid.robot_file.load import configs_folder
from tests.support.waiting import until

#: From the signal to the end of the last process, on a machine that has no more to do than cores.
LIMIT_S = 2.0
#: States in which the daemon may not have begun to listen for signals.
EARLY = ("importing", "waiting for stdin", "servos that do not answer", "board that does not answer")
#: Exit codes by state: 130, unless a fault ended the run or signal handlers are not installed yet.
CODES = {
    **dict.fromkeys(EARLY, (-signal.SIGTERM, 130)),
    "fault": (3,),
    "bus gone": (3,),
    "bus hangs": (3,),
}


def limit_s() -> float:
    """`LIMIT_S`, longer where processes wait for cores: interpreters end by arithmetic, without priority."""
    return LIMIT_S * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


@dataclass
class Leaving:
    """How one `contid run` ended after SIGTERM.

    Attributes:
        seconds: from SIGTERM to the end of its last process.
        code: its exit code.
        stderr: its output on stderr.
        left: what it left behind.
        limit_s: what `seconds` may be at most.
    """

    state: str
    seconds: float = 0.0
    code: int = 0
    stderr: str = ""
    left: list[str] = field(default_factory=list)

    limit_s: float = field(default_factory=lambda: limit_s())

    def violations(self) -> list[str]:
        out = [f"{self.state}: {what} left" for what in self.left]
        if self.seconds > self.limit_s:
            out.append(f"{self.state}: {self.seconds:.2f} s, {self.limit_s:.2f} s allowed")
        if "Traceback" in self.stderr:
            out.append(f"{self.state}: {self.stderr}")
        if self.code not in CODES.get(self.state, (130,)):
            out.append(f"{self.state}: exit code {self.code}: {self.stderr}")
        return out


@contextmanager
def dead_port() -> Iterator[str]:
    """A port that opens and never answers."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    try:
        yield os.ttyname(slave)
    finally:
        os.close(master)
        os.close(slave)


class EndedDaemons:
    """Starts one daemon after the other, waits for a state and ends it."""

    def __init__(self, dice: random.Random) -> None:
        self._dice = dice
        self._stack = ExitStack()

    def leave(self, state: Callable[[Self], None]) -> Leaving:
        """Reach a state, send SIGTERM, and look."""
        name = state.__name__.replace("_", " ")
        # Short: the path of a socket has 107 bytes.
        with tempfile.TemporaryDirectory(prefix="contid-") as folder, self._stack:
            self.folder = Path(folder)
            self._stack.callback(self._clean)
            state(self)
            assert self.process.poll() is None, self._stderr()
            family = [psutil.Process(self.process.pid)]
            family += family[0].children(recursive=True)
            begin_s = time.monotonic()
            self.process.send_signal(signal.SIGTERM)
            alive = left_alive(self.process, family, begin_s + 10.0)
            seconds = time.monotonic() - begin_s
            left = Leaving(name, seconds, self.process.wait(5.0), self._stderr())
            left.left += [f"process {each.pid}" for each in alive]
            if left.code != -signal.SIGTERM:  # else the next daemon clears it away
                left.left += [str(path) for path in ring_folder().glob(f"contid-{self.process.pid}-*")]
                left.left += [str(self.socket)] if self.socket.exists() else []
        return left

    def _clean(self) -> None:
        kill_family(self.process)
        if self.process.stdin is not None:
            with suppress(BrokenPipeError):
                self.process.stdin.close()

    def _start(self, text: str, *arguments: str, stdin: int = subprocess.DEVNULL) -> None:
        (self.folder / "robot.yaml").write_text(text)
        self.socket = self.folder / "s"
        with (self.folder / "stderr").open("wb") as stderr:
            command = [sys.executable, "-m", "contid", "run", "robot.yaml", "--socket", str(self.socket)]
            self.process = subprocess.Popen(
                [*command, *arguments], stdin=stdin, stdout=stderr, stderr=stderr, cwd=self.folder
            )

    def _dead(self, robot: str) -> None:
        port = self._stack.enter_context(dead_port())
        text = (configs_folder() / f"{robot}.emulated.yaml").read_text()
        text = re.sub(r"port: \S+", f"port: {port}", text)
        self._start(text)
        until(lambda: is_listening(self.socket) or self.process.poll() is not None, "the daemon listens")
        self._wait(0.0, 0.6)

    def _client(self) -> None:
        until(lambda: is_listening(self.socket) or self.process.poll() is not None, "the daemon listens")
        self.client = self._stack.enter_context(Client(self.socket))

    def _states(self) -> set[str]:
        return {robot["state"] for robot in self.client.status()["robots"].values()}

    def _until(self, state: str) -> None:
        until(lambda: self._states() == {state}, state)

    def _wait(self, least_s: float, most_s: float) -> None:
        time.sleep(self._dice.uniform(least_s, most_s))

    def _stderr(self) -> str:
        return (self.folder / "stderr").read_text(errors="replace")


def kill_family(process: subprocess.Popen[bytes]) -> None:
    """Kill a process and all that it started; returns once it has ended."""
    with suppress(psutil.NoSuchProcess):
        for each in psutil.Process(process.pid).children(recursive=True):
            each.kill()
    process.kill()
    process.wait()


def left_alive(
    process: subprocess.Popen[bytes], family: list[psutil.Process], until_s: float
) -> list[psutil.Process]:
    """Those of a family of processes that have not ended at a time of the monotonic clock; waits for it."""
    alive = family
    while alive and time.monotonic() < until_s:
        process.poll()
        alive = [each for each in alive if _alive(each)]
        time.sleep(0.002)
    return alive


def _alive(process: psutil.Process) -> bool:
    try:
        return bool(process.is_running() and process.status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False
