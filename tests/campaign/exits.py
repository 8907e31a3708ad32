"""SIGTERM in every state, in real time: every process gone within 2 s, and nothing left behind.

``python -m tests.campaign.exits [--rounds N] [--seed N]`` prints how long each state took. The instant within
a state is drawn at random. A stop that moves (``on_interrupt: rest``) may take as long as its motion on top.
"""

from __future__ import annotations

import argparse
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

import psutil

from contid.client import Client
from contid.control.process.shared_files import folder as ring_folder
from contid.remote.protocol.socket_path import is_listening
from contid.robot_file.shipped import configs_folder
from tests.support.fingers import fingers
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
AWAY = {"x_mm": 35.0, "y_mm": 80.0}


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


class Exits:
    """Runs one daemon after the other; states by name are its methods."""

    def __init__(self, dice: random.Random) -> None:
        self._dice = dice
        self._stack = ExitStack()

    # -- the states ----------------------------------------------------------------------------------------

    def importing(self) -> None:
        self._start(fingers(1))
        self._wait(0.0, 0.7)

    def waiting_for_stdin(self) -> None:
        self._start(fingers(1), stdin=subprocess.PIPE)
        self._wait(0.5, 1.5)

    def waiting_for_rows(self) -> None:
        self._start(fingers(1), stdin=subprocess.PIPE)
        assert self.process.stdin is not None
        self.process.stdin.write(b"x_mm,y_mm\n")
        self.process.stdin.flush()
        self._client()
        self._wait(0.0, 0.3)

    def servos_that_do_not_answer(self) -> None:
        self._dead("hand")

    def board_that_does_not_answer(self) -> None:
        self._dead("trirack")

    def connecting(self) -> None:
        silent = "".join(f"- {{at_s: 0.001, kind: silent, axis: f0.{side}}}\n" for side in ("left", "right"))
        self._start(fingers(1, options=f"faults:\n{_indented(silent)}"))
        self._client()
        self._wait(0.0, 1.0)

    def disarmed(self) -> None:
        self._start(fingers(2), "--disarmed")
        self._client()
        self._until("READY")

    def approach(self) -> None:
        self._start(fingers(1))
        self._client()
        self._until("HOLD")
        self.client.move(AWAY, wait=False)
        self._wait(0.0, 0.15)

    def run(self) -> None:
        self._start(fingers(1))
        self._client()
        self._until("HOLD")
        self.client.move({"x_mm": 50.0, "y_mm": 75.0})
        begun = self.client.request("move", columns=["x_mm", "y_mm"])
        self.client.request("rows", move=begun["move"], rows=[[50.0, 75.0]])
        self._until("RUN")

    def hold(self) -> None:
        self._start(fingers(2, buses=2))
        self._client()
        self._until("HOLD")
        self._wait(0.0, 0.1)

    def stopping(self) -> None:
        self._start(fingers(1, on_interrupt="rest"))
        self._client()
        self._until("HOLD")
        self.client.move(AWAY)
        self.client.stop()
        self._wait(0.0, 0.2)

    def fault(self) -> None:
        self._start(fingers(1, options="faults:\n  - {at_s: 0.5, kind: overload, axis: f0.left}\n"))
        self._client()
        self._until("FAULT")
        self._wait(0.0, 0.3)

    def bus_gone(self) -> None:
        self._start(fingers(2, buses=2, options="faults:\n  - {at_s: 0.5, kind: lost}\n"))
        self._client()
        until(lambda: "FAULT" in self._states(), "the bus is gone")
        self._wait(0.0, 1.5)

    def bus_hangs(self) -> None:
        """The exchange of the only bus does not come back."""
        self._start(fingers(1, options="faults:\n  - {at_s: 0.6, kind: late, delay_ms: 600000}\n"))
        self._client()
        until(lambda: self.client.status().get("tick_age_ms", 0.0) > 100.0, "it hangs")

    def with_clients(self) -> None:
        """One streams, one listens and does not read."""
        self.run()
        for _ in range(3):
            other = self._stack.enter_context(Client(self.socket))
            other.request("subscribe", rate_hz=200.0, events=True)
        self._wait(0.1, 0.5)

    def recording(self) -> None:
        self._start(fingers(1), "--record", "s.mcap")
        self._client()
        self._until("HOLD")
        self._wait(0.2, 0.6)

    # -- inside --------------------------------------------------------------------------------------------

    def leave(self, state: Callable[[Exits], None]) -> Leaving:
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
        with suppress(psutil.NoSuchProcess):
            for each in psutil.Process(self.process.pid).children(recursive=True):
                each.kill()
        self.process.kill()
        self.process.wait()
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


def _indented(lines: str) -> str:
    return "".join(f"  {line}\n" for line in lines.splitlines())


STATES: tuple[Callable[[Exits], None], ...] = (
    *(Exits.importing, Exits.waiting_for_stdin, Exits.waiting_for_rows, Exits.servos_that_do_not_answer),
    *(Exits.board_that_does_not_answer, Exits.connecting, Exits.disarmed, Exits.approach, Exits.run),
    *(
        Exits.hold,
        Exits.stopping,
        Exits.fault,
        Exits.bus_gone,
        Exits.bus_hangs,
        Exits.with_clients,
        Exits.recording,
    ),
)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign.exits", description="SIGTERM everywhere.")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    exits, wrong = Exits(random.Random(asked.seed)), []
    print(f"{'state':<32}{'cases':>8}{'median s':>10}{'worst s':>10}{'violations':>12}")
    for state in STATES:
        left = [exits.leave(state) for _ in range(asked.rounds)]
        seconds = sorted(each.seconds for each in left)
        found = [message for each in left for message in each.violations()]
        wrong += found
        times = f"{seconds[len(seconds) // 2]:>10.2f}{seconds[-1]:>10.2f}"
        print(f"{left[0].state:<32}{len(left):>8}{times}{len(found):>12}", flush=True)
    print("\n".join(wrong))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
