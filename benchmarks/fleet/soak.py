"""Soak of a fleet: four daemons and two bridges for an hour, with random faults of the table.

    python -m benchmarks.fleet.soak [--minutes 60] [--seed 1]

hand1 and hand2 share a bridge that lives through the whole run (it is stopped, and its links are cut);
that of hand3 and hand4 is killed too, and then started anew. `contid fleet status --watch` runs all the time.
Each round a program moves one robot by network, and one fault of the table strikes after a random time.
Printed: rounds, violations of the promise (min(lease, lease of the link) + 50 ms, and that what waited moves
nothing), memory and descriptors of daemons, control processes, bridge and table over time, a verdict. Beside
a violation stands how late a bare loop of 5 ms was meanwhile. ``--round-robin PRIORITY`` schedules what is
measured before other programs (SCHED_RR), for a machine that others keep busy. Exit code 1 when the
promise was broken, a process was lost, or memory or descriptors grow.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import subprocess
import sys
import threading
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from statistics import median
from typing import Final

import psutil

from benchmarks.flat import Look, look, slope_of
from benchmarks.on_sigterm import leave_on_sigterm
from contid.errors import ContidError
from tests.support.daemons import Running, armed, command, daemon
from tests.support.fleet_faults import FAULTS, FleetFault, leases, linked, strike
from tests.support.fleets import BridgeProcess, NotBegunError
from tests.support.relay import Relay

PROMISE_S: Final = 0.05
#: Nodes of the bridge that lives through the run, and of the one that is killed.
LASTING: Final = ("hand1", "hand2")
KILLED: Final = ("hand3", "hand4")
LINE_S: Final = 60.0
#: The bare loop, and from where on its lateness is kept.
BARE_PERIOD_S: Final = 0.005
BARE_LATE_S: Final = 0.01


class Drain:
    """Reads what a process writes, so that no pipe becomes full."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        for stream in (process.stdout, process.stderr):
            if stream is not None:
                threading.Thread(target=self._read, args=(os.dup(stream.fileno()),), daemon=True).start()

    @staticmethod
    def _read(descriptor: int) -> None:
        while os.read(descriptor, 1 << 16):
            pass
        os.close(descriptor)


class BareLoop:
    """How late a loop of 5 ms without any work is; a process of its own at the same priority."""

    def __init__(self) -> None:
        self._late: list[tuple[float, float]] = []
        self.process = subprocess.Popen(
            [sys.executable, "-c", _BARE], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True
        )
        self._reading = threading.Thread(target=self._read, daemon=True)
        self._reading.start()

    def close(self) -> None:
        """End it."""
        self.process.kill()
        self._reading.join()
        self.process.communicate()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            at_s, late_s = map(float, line.split())
            self._late.append((at_s, late_s))

    def worst_s(self, begin_s: float, end_s: float) -> float:
        """Largest lateness in a time."""
        return max((late for at, late in tuple(self._late) if begin_s <= at <= end_s), default=0.0)


_BARE: Final = f"""
import time
next_s = time.monotonic()
while True:
    next_s += {BARE_PERIOD_S}
    time.sleep(max(next_s - time.monotonic(), 0.0))
    now_s = time.monotonic()
    if now_s - next_s > {BARE_LATE_S}:
        print(now_s, now_s - next_s, flush=True)
        next_s = now_s
"""


class Watched:
    """Memory and descriptors of processes over time."""

    def __init__(self, processes: Mapping[str, psutil.Process]) -> None:
        self._processes = processes
        self.looks: dict[str, list[Look]] = {name: [] for name in processes}

    def look(self, t_s: float) -> None:
        """Look at every process; raises when one is gone."""
        for name, process in self._processes.items():
            self.looks[name].append(look(process, t_s))

    def line(self) -> str:
        """The newest looks: own memory and descriptors."""
        return ", ".join(
            f"{name} {looks[-1].own_kb / 1024:.1f} MB {looks[-1].descriptors} fd"
            for name, looks in self.looks.items()
        )


@contextmanager
def _table(served: BridgeProcess) -> Iterator[subprocess.Popen[bytes]]:
    """`contid fleet status --watch`."""
    path = served.operator_file("bob", LASTING, connect=[served.endpoint])
    process = subprocess.Popen(
        command("fleet", "status", "--watch", "--json", "--file", str(path)),
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def _slower(robot_file: str) -> str:
    """Half the ticks: four control processes share the machine with everything else."""
    return robot_file.replace("rate_hz: 200", "rate_hz: 100")


def _before_others(pid: int, priority: int) -> None:
    """Schedule every thread of a process with SCHED_RR, and not what it starts later; 0 leaves them."""
    for thread in Path(f"/proc/{pid}/task").iterdir() if priority else ():
        with suppress(ProcessLookupError):
            policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
            os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority))


def _family(name: str, node: Running) -> dict[str, psutil.Process]:
    """A daemon and its control process."""
    parent = psutil.Process(node.process.pid)
    control = [each for each in parent.children(recursive=True) if "contid.control.process" in each.cmdline()]
    return {name: parent, **{f"{name} control": each for each in control}}


class KilledBridge:
    """The bridge of the nodes whose bridge is killed: a new one after each death."""

    def __init__(self, nodes: Mapping[str, Running], priority: int) -> None:
        self._nodes = nodes
        self._priority = priority
        self._stack = ExitStack()
        self.now = self._start()

    def renew(self) -> None:
        """Start a new one if this one is dead."""
        if self.now[0].process.poll() is not None:
            self.close()
            self.now = self._start()

    def close(self) -> None:
        """End it."""
        self._stack.close()

    def _start(self) -> tuple[BridgeProcess, Relay]:
        served, relay = self._stack.enter_context(linked(self._nodes))
        _before_others(served.process.pid, self._priority)
        return served, relay


def kept(fault: FleetFault, lease_s: float, held_s: float, promise_s: float) -> bool:
    """True when the robot held in time, or did not hold because it must not."""
    limit_s = fault.limit_s(lease_s)
    return held_s == math.inf if limit_s == math.inf else held_s <= limit_s + promise_s


def soak(
    minutes: float,
    seed: int = 1,
    promise_s: float = PROMISE_S,
    faults: Collection[str] = tuple(FAULTS),
    priority: int = 0,
) -> int:
    """Run, print, judge; returns the exit code."""
    chosen = random.Random(seed)
    with ExitStack() as stack:
        nodes = {name: stack.enter_context(daemon(change=_slower)) for name in (*LASTING, *KILLED)}
        for node in nodes.values():
            Drain(node.process)
            with node.client() as client:
                armed(client)
            _before_others(node.process.pid, priority)
        served, relay = stack.enter_context(linked({name: nodes[name] for name in LASTING}))
        Drain(served.process)
        _before_others(served.process.pid, priority)
        dying = KilledBridge({name: nodes[name] for name in KILLED}, priority)
        stack.callback(dying.close)
        table = stack.enter_context(_table(served))
        bare = BareLoop()
        stack.callback(bare.close)
        members = {key: each for name, node in nodes.items() for key, each in _family(name, node).items()}
        members |= {"bridge": psutil.Process(served.process.pid), "table": psutil.Process(table.pid)}
        watched = Watched(members)

        def begun(moving: subprocess.Popen[str]) -> None:
            # Again also where it was done before: threads that were started since then.
            own = (moving.pid, os.getpid(), bare.process.pid, served.process.pid, dying.now[0].process.pid)
            for pid in (*own, *(node.process.pid for node in nodes.values())):
                _before_others(pid, priority)

        excess: dict[str, list[float]] = {name: [] for name in FAULTS}
        violations: list[str] = []
        rounds = not_begun = 0
        begin_s = next_line_s = time.monotonic()
        while time.monotonic() < begin_s + 60.0 * minutes:
            name = chosen.choice([*nodes])
            kinds = [kind for kind in faults if name in KILLED or kind != "bridge killed"]
            fault = FAULTS[chosen.choice(kinds)]
            lease_s, delay_s = leases(fault, chosen), chosen.uniform(0.0, 0.5)
            at_s = time.monotonic()
            through = (served, relay) if name in LASTING else dying.now
            what = f"round {rounds}: {name}, {fault.name}, lease {lease_s:.1f} s"
            try:
                held_s = strike(nodes[name], name, *through, fault, lease_s, delay_s, begun)
            except NotBegunError:
                not_begun += 1
            except ContidError as error:  # the daemon closed the connection
                violations.append(f"{what}: {error}; exit code of the daemon: {nodes[name].process.poll()}")
            except AssertionError as error:
                violations.append(f"{what}: {error}")
            else:
                if fault.limit_s(lease_s) < math.inf:
                    excess[fault.name].append(held_s - fault.limit_s(lease_s))
                if not kept(fault, lease_s, held_s, promise_s):
                    late_s = bare.worst_s(at_s, time.monotonic())
                    violations.append(
                        f"{what}: held after {held_s:.3f} s; the bare loop was {late_s:.3f} s late"
                    )
            if violations and violations[-1].startswith(what):
                print("VIOLATION " + violations[-1], flush=True)
            rounds += 1
            dying.renew()
            watched.look(time.monotonic() - begin_s)
            if time.monotonic() >= next_line_s:
                next_line_s += LINE_S
                print(f"{time.monotonic() - begin_s:6.0f} s, {rounds} rounds: {watched.line()}", flush=True)
        return _judge(rounds - not_begun, excess, violations, watched)


def _judge(rounds: int, excess: Mapping[str, list[float]], violations: list[str], watched: Watched) -> int:
    for name, values in excess.items():
        if values:
            least, middle, most = (1e3 * each(values) for each in (min, median, max))
            print(f"{name}: {len(values)} times, {least:+.0f} to {most:+.0f} ms, median {middle:+.0f} ms")
    slopes = {name: slope_of(looks) for name, looks in watched.looks.items()}
    for name, slope in slopes.items():
        print(f"{name}: {slope}")
    growing = [name for name, slope in slopes.items() if not slope.flat]
    print(f"{rounds} rounds, {len(violations)} violations; grows: {', '.join(growing) or 'nothing'}")
    return 1 if violations or growing else 0


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--round-robin", type=int, default=0, metavar="PRIORITY")
    options = parser.parse_args()
    return soak(options.minutes, options.seed, priority=options.round_robin)


if __name__ == "__main__":
    leave_on_sigterm()
    sys.exit(main())
