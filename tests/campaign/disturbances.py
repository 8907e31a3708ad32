"""Kills, suspensions, starvation and shifted clocks of whole daemons on emulated wires, from a seed.

``python -m tests.campaign.disturbances [--rounds N] [--seed N] [--kind KIND]`` prints a table. A case starts
a daemon on the laboratory (servos, motors and chambers on Due boards) or on the chain (two arms and a rope),
moves its robots, disturbs it at a random instant, and looks at the devices from their side of the wire:

| disturbance | must |
|---|---|
| SIGKILL of one process | motors off, chambers empty, servos still; without a recorder the run goes on |
| SIGSTOP, later SIGCONT, of all processes | as above while it lasts; every robot comes back by orders |
| all processes behind busy ones, without rights | no output outside its range; every robot comes back |
| all processes in a cgroup with 2 to 30 % of a core | as above |
| a clock of another epoch (time namespace) | as without it |

After each: no process and no ring left (a ring of a killed run is gone after the next start), and
`contid_sessions.check` finds nothing in the session.
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final

import psutil

from contid.control.process.shared_files import folder as ring_folder
from contid.errors import ContidError
from tests.campaign.disturbed_daemon import PLANTS, Case
from tests.campaign.wired.daemon import NotStartedError
from tests.campaign.wired.wires import Wires
from tests.support import cpu_quota

#: Starts that may fail in a row: emulators of a busy machine may not answer in time.
MOST_FAILED_STARTS: Final = 5
VICTIMS: Final = {
    "daemon": "contid run",
    "control process": "contid.control.process",
    "recorder": "contid.session.mcap_recorder",
}
#: Beyond every epoch in use: ten years of uptime, where float64 has 60 ns.
EPOCHS_S: Final = (315_360_000, 4_000_000_000, 86_400)
BUSY: Final = 4
BUSY_S: Final = 2.0


def kill(case: Case, dice: random.Random, victim: str) -> str:
    """SIGKILL of one process."""
    case.move()
    for each in case.family():
        with suppress(psutil.NoSuchProcess):
            if VICTIMS[victim] in " ".join(each.cmdline()).replace("-m contid run", "contid run"):
                if victim != "daemon" and each.pid == case.process.pid:
                    continue
                each.kill()
                break
    else:
        raise AssertionError(f"no {victim}")
    if victim == "recorder":
        case.back("recorder killed")
    else:
        case.undriven(f"{victim} killed")
    return f"kill {victim}"


def suspend(case: Case, dice: random.Random, longest_s: float) -> str:
    """Every process stands still and goes on."""
    case.move()
    seconds = math.exp(dice.uniform(math.log(0.06), math.log(longest_s)))
    family = case.family()
    for each in family:
        each.suspend()
    time.sleep(min(seconds, 1.0))
    if seconds > 1.0:
        begin_s = time.monotonic()
        case.undriven(f"suspended for {seconds:.2f} s")
        time.sleep(max(0.0, begin_s + seconds - 1.0 - time.monotonic()))
    for each in family:
        each.resume()
    case.back(f"suspended for {seconds:.2f} s")
    return "suspend"


def starve(case: Case, dice: random.Random) -> str:
    """No real-time rights, the lowest share of the processors, and busy processes before it."""
    case.move()
    _without_rights(case, os.SCHED_IDLE)
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(BUSY)]
    try:
        time.sleep(BUSY_S)
    finally:
        for loop in busy:
            loop.kill()
            loop.wait()
    case.back("load ended")
    return "starve"


def throttle(case: Case, dice: random.Random) -> str:
    """No real-time rights, and a share of a core that the kernel takes away for most of each 0.1 s."""
    case.move()
    _without_rights(case, os.SCHED_OTHER)
    share = math.exp(dice.uniform(math.log(0.02), math.log(0.3)))
    with cpu_quota.quota([each.pid for each in case.family()], share):
        time.sleep(dice.uniform(0.5, 2.0 * BUSY_S))
    case.back(f"no longer limited to {share:.0%} of a core")
    return "quota"


def _without_rights(case: Case, policy: int) -> None:
    for each in case.family():
        for thread in each.threads():
            with suppress(ProcessLookupError):
                os.sched_setscheduler(thread.id, policy, os.sched_param(0))


def shifted(case: Case, dice: random.Random) -> str:
    """The daemon was started with another epoch: it moves, stops and resumes."""
    case.move()
    with case._client() as client:
        client.estop()
    case.undriven("estop under another epoch")
    case.back("another epoch")
    return "epoch"


@contextmanager
def started(plant: str, dice: random.Random, epoch_s: int = 0) -> Iterator[Case]:
    """A daemon on its plant."""
    with tempfile.TemporaryDirectory(prefix="contid-") as folder, ExitStack() as stack:
        wires = stack.enter_context(Wires(PLANTS[plant](Path(folder))))
        case = Case(Path(folder), wires, dice, epoch_s)
        stack.callback(case.clean)
        yield case


def obstacle(kind: str) -> str:
    """Why a kind of case cannot be tried by this user; empty if it can."""
    if kind == "quota":
        return cpu_quota.obstacle()
    if kind == "epoch":
        with suppress(OSError):
            if subprocess.run(["unshare", "-T", "true"], capture_output=True).returncode == 0:
                return ""
        return "this user may not make time namespaces (unshare -T)"
    return ""


def one(plant: str, kind: str, dice: random.Random, longest_s: float = 12.0) -> list[str]:
    """One case; what it violated."""
    epoch_s = dice.choice(EPOCHS_S) if kind == "epoch" else 0
    with started(plant, dice, epoch_s) as case:
        if kind == "suspend":
            suspend(case, dice, longest_s)
        elif kind == "starve":
            starve(case, dice)
        elif kind == "quota":
            throttle(case, dice)
        elif kind == "epoch":
            shifted(case, dice)
        else:
            kill(case, dice, kind.removeprefix("kill "))
        pid = case.process.pid
        case.end(f"{plant}: {kind}")
        found = case.violations
        rings = list(ring_folder().glob(f"contid-{pid}-*"))
        if rings and kind not in ("kill daemon", "kill control process"):
            found += [f"{plant}: {kind}: {path} left" for path in rings]
    return found


KINDS: Final = (*(f"kill {victim}" for victim in VICTIMS), "suspend", "starve", "quota", "epoch")


def _tried(plant: str, kind: str, dice: random.Random, failed_starts: list[str]) -> list[str]:
    """One case; what it violated, also that it got nowhere. Starts that failed are added to a list."""
    try:
        for _ in range(MOST_FAILED_STARTS):
            try:
                return one(plant, kind, dice)
            except NotStartedError as error:
                failed_starts.append(f"{plant}: {kind}: {error}")
        return [f"{plant}: {kind}: does not start: {failed_starts[-1]}"]
    except (AssertionError, ContidError, OSError) as error:
        return [f"{plant}: {kind}: {error!r}"]


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign.disturbances", description="Disturbed runs."
    )
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", action="append", choices=KINDS, help="only these; may be repeated")
    asked = parser.parse_args()
    cases, wrong = Counter[str](), Counter[str]()
    messages: list[str] = []
    failed_starts: list[str] = []
    kinds = asked.kind or KINDS
    hindered = {kind: why for kind in kinds if (why := obstacle(kind))}
    with suppress(KeyboardInterrupt):
        for number in range(asked.rounds):
            for plant, kind in itertools.product(PLANTS, [each for each in kinds if each not in hindered]):
                found = _tried(
                    plant, kind, random.Random(f"{asked.seed}:{number}:{plant}:{kind}"), failed_starts
                )
                cases[f"{plant}: {kind}"] += 1
                wrong[f"{plant}: {kind}"] += bool(found)
                messages += [f"round {number}: {each}" for each in found]
    print(f"{'case':<32}{'cases':>8}{'violations':>12}")
    for name, count in cases.items():
        print(f"{name:<32}{count:>8}{wrong[name]:>12}")
    for kind, why in hindered.items():
        print(f"{kind}: not tried; {why}")
    if failed_starts:
        print(f"starts that failed, tried again: {len(failed_starts)}", *failed_starts, sep="\n")
    print(*messages, sep="\n", end="\n" if messages else "")
    return 1 if messages else 0


if __name__ == "__main__":
    sys.exit(main())
