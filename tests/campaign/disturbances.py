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
`contid.session.check` finds nothing in the session.
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final

import psutil
import yaml

from contid.client import Client
from contid.control.process.ring import folder as ring_folder
from contid.errors import ContidError
from contid.remote.protocol.socket_path import is_listening
from contid.robot_file.shipped import configs_folder
from contid.session.check import check_session
from contid.session.read import Session
from tests.campaign.wired.lab_file import LONG_TIMEOUTS, TOLERANCE_TICKS, robot_file
from tests.campaign.wired.wires import Wires
from tests.support import cpu_quota
from tests.support.waiting import until

#: Orders after the first motion, so that every state is met; "arming" is an estop and a resume.
ORDERS: Final = ("", "", "hold", "stop", "estop", "arming")
#: Starts that may fail in a row: emulators of a busy machine may not answer in time.
MOST_FAILED_STARTS: Final = 5
#: Watchdogs of 0.4 s, the wire, and the plants: motors are off, chambers are empty.
UNDRIVEN_S: Final = 4.0
BACK_S: Final = 30.0
LEAVE_S: Final = 30.0
#: Of a shaft [ticks/s or counts/s].
STILL: Final = 1.0
VICTIMS: Final = {
    "daemon": "contid run",
    "control process": "contid.control.process",
    "recorder": "contid.session.mcap_recorder",
}
#: Beyond every epoch in use: ten years of uptime, where float64 has 60 ns.
EPOCHS_S: Final = (315_360_000, 4_000_000_000, 86_400)
BUSY: Final = 4
BUSY_S: Final = 2.0


def chain_file(folder: Path) -> Path:
    """The chain on its emulated boards, with their ports in a folder."""
    raw = yaml.safe_load((configs_folder() / "chain.emulated.yaml").read_text(encoding="utf-8"))
    for name, bus in raw["buses"].items():
        bus |= {"port": f"{folder}/{name}.tty", "tolerance_ticks": TOLERANCE_TICKS} | LONG_TIMEOUTS["due"]
    path = folder / "chain.yaml"
    path.write_text(yaml.safe_dump(raw, sort_keys=False, default_flow_style=None))
    return path


PLANTS: Final[dict[str, Callable[[Path], Path]]] = {"lab": robot_file, "chain": chain_file}


class NotStartedError(Exception):
    """A daemon did not come to hold its robots."""


class Case:
    """One daemon and what became of it.

    Attributes:
        violations: descriptions.
    """

    def __init__(self, folder: Path, wires: Wires, dice: random.Random, epoch_s: int = 0) -> None:
        self.violations: list[str] = []
        self._stopped = False
        self._folder, self._wires, self._dice = folder, wires, dice
        self._socket, self._session = folder / "s", folder / f"{dice.getrandbits(40)}.mcap"
        command = [sys.executable, "-m", "contid", "run", str(wires.path), "--socket", str(self._socket)]
        before = ["unshare", "-T", "--monotonic", str(epoch_s)] if epoch_s else []
        with (folder / "stderr").open("ab") as stderr:
            self.process = subprocess.Popen(
                [*before, *command, "--record", str(self._session)],
                stdin=subprocess.DEVNULL, stdout=stderr, stderr=stderr, start_new_session=True,
            )  # fmt: skip
        try:
            until(lambda: is_listening(self._socket) or self.process.poll() is not None, "it listens")
            with self._client() as client:
                until(lambda: self._states(client) == {"HOLD"}, "armed")
        except (AssertionError, ContidError, OSError) as error:
            self.clean()
            printed = (folder / "stderr").read_text(errors="replace")
            raise NotStartedError(f"{error}: {printed[-500:]}") from error
        except BaseException:
            self.clean()
            raise

    def _client(self) -> Client:
        return Client(self._socket, name="disturbances", timeout_s=30.0)

    @staticmethod
    def _states(client: Client) -> set[str]:
        return {str(robot["state"]) for robot in client.status()["robots"].values()}

    def family(self) -> list[psutil.Process]:
        """Daemon, control process and recorder."""
        with suppress(psutil.NoSuchProcess):
            top = psutil.Process(self.process.pid)
            return [top, *top.children(recursive=True)]
        return []

    def move(self) -> None:
        """Every robot moves by a few millimetres, then perhaps gets another order."""
        with self._client() as client:
            target = {}
            for name, robot in client.status()["robots"].items():
                for axis, values in robot.get("axes", {}).items():
                    if values["command_mm" if robot["unit"] == "mm" else "command_bar"] is not None:
                        unit = robot["unit"]
                        near = values[f"min_{unit}"] + 0.5 * (values[f"max_{unit}"] - values[f"min_{unit}"])
                        target[f"{name}.{axis.partition('.')[2] or axis}_{unit}"] = near
            with suppress(ContidError):  # a chain refuses what would stretch its rope
                client.move(target, wait=False)
            time.sleep(self._dice.uniform(0.0, 0.5))
            order = self._dice.choice(ORDERS)
            if order in ("estop", "arming"):
                client.estop()
            if order == "arming":
                client.resume(after_stop=True)
            if order in ("hold", "stop"):
                getattr(client, order)()
            self._stopped = order == "stop"
        time.sleep(self._dice.uniform(0.0, 0.1))

    def undriven(self, what: str) -> None:
        """No output may stay driven."""
        end_s = time.monotonic() + UNDRIVEN_S
        while still := self._driven():
            if time.monotonic() > end_s:
                self.violations.append(f"{what}: {', '.join(sorted(still))} driven after {UNDRIVEN_S} s")
                return
            time.sleep(0.01)

    def _driven(self) -> list[str]:
        """Motors under power, chambers under pressure, servos that move: their watchdog keeps the torque.

        Motors that were stopped by the policy ``hold`` hold without the daemon; they must not move.
        """
        holding = {probe.axis for probe in self._wires.servos if abs(probe.servo.motion.velocity) <= STILL}
        if self._stopped:
            holding |= {
                probe.axis for probe in self._wires.channels if probe.motor and abs(probe.speed_now) <= STILL
            }
        return [name for name in self._wires.driven() if name not in holding]

    def back(self, what: str) -> None:
        """Clear and resume until every robot holds."""
        end_s, found, refusal = time.monotonic() + BACK_S, set[str](), ""
        while time.monotonic() < end_s:
            with suppress(OSError, ContidError), self._client() as client:
                client.acquire(60.0, takeover=True)
                for order in (client.clear_fault, lambda: client.resume(after_stop=True), client.hold):
                    try:
                        order()
                    except ContidError as error:
                        refusal = str(error)
                found = self._states(client)
                if found <= {"HOLD"}:
                    return
            time.sleep(0.1)
        self.violations.append(f"{what}: not back: {found} {refusal}")

    def end(self, what: str) -> None:
        """SIGTERM if it still runs; nothing may be left, and the session must keep the rules."""
        family = self.family()
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(LEAVE_S)
        _, alive = psutil.wait_procs(family, timeout=LEAVE_S)
        self.violations += [f"{what}: process {each.pid} left" for each in alive]
        self.violations += [f"{what}: wrong at a device: {wrong}" for wrong in self._wrong()]
        session = Session(self._session)
        self.violations += [f"{what}: session: {each}" for each in list(check_session(session))[:3]]
        stderr = (self._folder / "stderr").read_text(errors="replace")
        self.violations += [f"{what}: {stderr[-1500:]}"] if "Traceback" in stderr else []

    def _wrong(self) -> list[str]:
        boards = [message for probe in self._wires.channels for message in probe.wrong]
        return boards + [message for probe in self._wires.servos for message in probe.wrong]

    def clean(self) -> None:
        """Kill what is left, whatever happened."""
        for each in self.family():
            with suppress(psutil.NoSuchProcess):
                each.kill()
        self.process.wait()


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
