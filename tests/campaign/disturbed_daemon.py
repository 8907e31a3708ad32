"""A daemon on emulated wires that is moved, disturbed and looked at from the side of the devices."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

import psutil
import yaml

from contid.client import Client
from contid.errors import ContidError
from contid.remote.protocol.socket_path import is_listening
from contid.robot_file.load import configs_folder
from contid.session.read import Session
from contid_sessions.check import check_session
from tests.campaign.wired.daemon import NotStartedError
from tests.campaign.wired.lab_file import LONG_TIMEOUTS, TOLERANCE_TICKS, robot_file
from tests.campaign.wired.wires import Wires
from tests.support.waiting import until

#: Orders after the first motion, so that every state is met; "arming" is an estop and a resume.
ORDERS: Final = ("", "", "hold", "stop", "estop", "arming")
#: Watchdogs of 0.4 s, the wire, and the plants: motors are off, chambers are empty.
UNDRIVEN_S: Final = 4.0
BACK_S: Final = 30.0
LEAVE_S: Final = 30.0
#: Of a shaft [ticks/s or counts/s].
STILL: Final = 1.0


def chain_file(folder: Path) -> Path:
    """The chain on its emulated boards, with their ports in a folder."""
    raw = yaml.safe_load((configs_folder() / "chain.emulated.yaml").read_text(encoding="utf-8"))
    for name, bus in raw["buses"].items():
        bus |= {"port": f"{folder}/{name}.tty", "tolerance_ticks": TOLERANCE_TICKS} | LONG_TIMEOUTS["due"]
    path = folder / "chain.yaml"
    path.write_text(yaml.safe_dump(raw, sort_keys=False, default_flow_style=None))
    return path


PLANTS: Final[dict[str, Callable[[Path], Path]]] = {"lab": robot_file, "chain": chain_file}


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
