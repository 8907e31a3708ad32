"""Random spellings of an emergency stop over a real socket, beside random mixes of floods.

``python -m tests.campaign.stops [--rounds N] [--seed N]`` prints a table. A round arms the robot, sends a
request that is no stop (the robot stays on), then a random spelling from a connection of its own, sometimes
without the end of its line: within `LIMIT_S` the journal of the simulated devices has no torque on, and a
connection that stays open gets an answer. The delays are printed; `benchmarks.stop_latency` measures them.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import random
import socket
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from benchmarks.stop_latency import cheap, connects, heavy, subscribes
from contid.client import Client
from contid.errors import ContidError
from tests.campaign.spellings import Spellings
from tests.support.daemons import Running, armed
from tests.support.daemons import fast_daemon as daemon

#: Far beyond every measured delay: a stop that takes longer is lost.
LIMIT_S: Final = 10.0
#: Rounds beside one mix.
PER_MIX: Final = 50
FLOODS: Final[dict[str, Callable[[str], None]]] = {
    "heavy": heavy,
    "cheap": cheap,
    "subscribers": subscribes,
    "connecting": connects,
}


@contextmanager
def flooded(path: Path, mix: Sequence[str]) -> Iterator[None]:
    """Every flood of a mix in a process of its own."""
    context = multiprocessing.get_context("spawn")
    crowd = [context.Process(target=FLOODS[name], args=(str(path),), daemon=True) for name in mix]
    for each in crowd:
        each.start()
    try:
        yield
    finally:
        for each in crowd:
            each.kill()
            each.join()


def driven(running: Running) -> bool:
    """A device has torque, by the last whole line of the journal."""
    with (running.folder / "journal.jsonl").open("rb") as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - 65_536))
        whole = file.read().rpartition(b"\n")[0].rpartition(b"\n")[2]
    return any(axis["on"] for axis in json.loads(whole)["axes"].values())


class Siege:
    """One daemon, its stops and what went wrong.

    Attributes:
        obeyed_s: from the first byte of each stop to the journal without torque.
        violations: descriptions with the line that was sent.
    """

    def __init__(self, running: Running, dice: random.Random) -> None:
        self.obeyed_s: list[float] = []
        self.violations: list[str] = []
        self._running, self._dice = running, dice
        self._lines = Spellings(dice)

    def round(self) -> None:
        """Arm, send another request, send a stop."""
        self._arm()
        while b'"stop"' in (other := self._lines.other()):
            pass  # it stops by its policy
        self._send(other, ends=True)
        if not driven(self._running):
            self.violations.append(f"no stop, but the robot stopped: {other!r}")
            self._arm()
        line = self._lines.estop()
        ends = self._dice.random() < 0.9
        begin_s = time.monotonic()
        answered = self._send(line, ends)
        while driven(self._running):
            if time.monotonic() > begin_s + LIMIT_S:
                self.violations.append(f"not obeyed: {line!r}")
                return
            time.sleep(0.0005)
        self.obeyed_s.append(time.monotonic() - begin_s)
        if ends and not answered:
            self.violations.append(f"not answered: {line!r}")

    def _arm(self) -> None:
        """Every robot holds; a client displaced by the flood connects again."""
        deadline_s = time.monotonic() + 60.0
        while True:
            try:
                with Client(self._running.socket, name="arming", timeout_s=30.0) as client:
                    client.resume(after_stop=True)
                    armed(client)
                if driven(self._running):
                    return
            except ContidError:
                if time.monotonic() > deadline_s:
                    raise

    def _send(self, line: bytes, ends: bool) -> bool:
        """Send a line from a new connection; True when it was answered."""
        deadline_s = time.monotonic() + LIMIT_S
        while time.monotonic() < deadline_s:
            with suppress(OSError), socket.socket(socket.AF_UNIX) as connection:
                connection.settimeout(LIMIT_S)
                connection.connect(str(self._running.socket))
                hello = connection.recv(65_536)
                connection.sendall(line + b"\n" if ends else line)
                if not ends:
                    return False
                answer = hello.partition(b"\n")[2] or connection.recv(65_536)
                if answer:
                    return True
        return False


def siege(rounds: int, seed: int) -> int:
    """All rounds; prints the table and returns the number of violations."""
    dice, count = random.Random(seed), 0
    print(f"{'beside':<44}{'stops':>7}{'p50 ms':>9}{'p99 ms':>9}{'max ms':>9}{'violations':>12}")
    while rounds > 0:
        mix = sorted(name for name in FLOODS if dice.random() < 0.4)
        with daemon() as running, flooded(running.socket, mix):
            here = Siege(running, dice)
            for _ in range(min(rounds, PER_MIX)):
                here.round()
            rounds -= PER_MIX
        took = sorted(here.obeyed_s) or [float("nan")]
        cells = "".join(f"{took[int(share * (len(took) - 1))] * 1e3:9.1f}" for share in (0.5, 0.99, 1.0))
        print(f"{', '.join(mix) or 'nothing':<44}{len(here.obeyed_s):>7}{cells}{len(here.violations):>12}")
        print(*here.violations, sep="\n", end="\n" if here.violations else "", flush=True)
        count += len(here.violations)
    return count


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign.stops", description="Stops under siege.")
    parser.add_argument("--rounds", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    return 1 if siege(asked.rounds, asked.seed) else 0


if __name__ == "__main__":
    sys.exit(main())
