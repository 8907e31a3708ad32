"""Participants of the soak: the operator, clients, and the script that streams."""

from __future__ import annotations

import itertools
import json
import math
import socket
import threading
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Final

from benchmarks.soak_lab import RATE_HZ, UNPLUG
from contid.client import Client
from contid.control.engine.wiring import build_robot_configs
from contid.errors import ContidError
from contid.robot_file.load import LoadedFile

#: How long a cable is out, and how long the end of a run waits for its robots.
OUT_S: Final = 2.0
BACK_S: Final = 20.0
ARMED: Final = frozenset({"HOLD", "RUN", "APPROACH"})


@dataclass
class Cable:
    """One pulled cable: its bus, the time, the robots that faulted, the time until they were back."""

    bus: str
    at_s: float
    robots: frozenset[str]
    faulted: set[str] = field(default_factory=set)
    back_s: float = math.nan


class Operator(threading.Thread):
    """Pulls cables, plugs them in, clears the faults and resumes like a human operator; counts the faults."""

    def __init__(self, folder: Path, loaded: LoadedFile, times_s: Sequence[float]) -> None:
        super().__init__(name="operator")
        self._folder = folder
        self._loaded = loaded
        self._times_s = list(times_s)
        self._ended = threading.Event()
        self._give_up_s = math.inf
        self._faulted: set[str] = set()
        self.cables: list[Cable] = []
        self.others: Counter[str] = Counter()
        self.begin_s = time.monotonic()

    def stop(self) -> None:
        """No further cable; waits for the robots of the last one."""
        self._give_up_s = time.monotonic() + BACK_S
        self._ended.set()
        self.join()

    def run(self) -> None:
        """Until stopped."""
        buses = itertools.cycle(self._loaded.buses.values())
        pulls = iter(self._times_s)
        next_s = next(pulls, math.inf)
        with Client(self._folder / "lab.sock", name="operator") as client:
            while not self._ended.is_set() or (self._waiting and time.monotonic() < self._give_up_s):
                time.sleep(0.2)
                well = self._all_well(client)
                if well and self._waiting:
                    self.cables[-1].back_s = time.monotonic() - self.begin_s - self.cables[-1].at_s - OUT_S
                # A robot that is in FAULT already cannot report the cable.
                due = time.monotonic() >= self.begin_s + next_s
                if due and well and not (self._ended.is_set() or self._waiting):
                    next_s = next(pulls, math.inf)
                    self._pull(next(buses).name)

    @property
    def _waiting(self) -> bool:
        """True while robots of the last cable are not back."""
        return bool(self.cables) and math.isnan(self.cables[-1].back_s)

    def _all_well(self, client: Client) -> bool:
        """Count new faults; clear and resume what is not armed."""
        status = client.status()["robots"]
        for name, robot in status.items():
            if robot["fault"] and name not in self._faulted:
                self._count(name, robot["fault"]["name"])
        self._faulted = {name for name, robot in status.items() if robot["fault"]}
        if all(robot["state"] in ARMED for robot in status.values()):
            return True
        with suppress(ContidError):  # its bus is not back yet: once more in a moment
            client.clear_fault()
            client.resume(wait=False, after_stop=True)
        return False

    def _pull(self, bus: str) -> None:
        wiring = self._loaded.buses[bus]
        robots = frozenset(axis.split(".", 1)[0] for axis, _ in wiring.axes)
        self.cables.append(Cable(bus, time.monotonic() - self.begin_s, robots))
        out, back = UNPLUG[wiring.driver]
        with (self._folder / f"{bus}.switch").open("a") as switch:
            switch.write(json.dumps({"fault": out}) + "\n")
            switch.flush()
            time.sleep(OUT_S)
            switch.write(json.dumps({"fault": back}) + "\n")

    def _count(self, robot: str, fault: str) -> None:
        """A fault is that of the last cable when it is one of its robots, until they are back."""
        cable = self.cables[-1] if self.cables else None
        if cable is not None and robot in cable.robots and math.isnan(cable.back_s):
            cable.faulted.add(robot)
        else:
            self.others[f"{robot}: {fault}"] += 1


class Clients:
    """Clients that connect, subscribe, send garbage and disconnect."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._open: list[socket.socket] = []
        self.visits = 0

    def visit(self) -> None:
        """Connect one more; the oldest of three is closed with its data unread."""
        end = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._open.append(end)
        with suppress(OSError):
            end.connect(str(self._path))
            end.sendall(
                b'{"id": 1, "verb": "status"}\n{"id": 2, "verb": "subscribe", "rate_hz": 50}\nrubbish\n'
            )
            self.visits += 1
        while len(self._open) > 3:
            self._open.pop(0).close()

    def close(self) -> None:
        """Disconnect all."""
        for end in self._open:
            end.close()


class Stream(threading.Thread):
    """Every axis around the middle of its travel, 20 rows a second on the daemon's stdin."""

    def __init__(self, pipe: IO[str], loaded: LoadedFile) -> None:
        super().__init__(name="stream")
        self._pipe = pipe
        self._ended = threading.Event()
        self._names, self._swings = [], []
        for config in build_robot_configs(loaded, RATE_HZ):
            for axis, limits in zip(config.axis_names, config.limits, strict=True):
                scale = config.quantity.per_si
                self._names.append(f"{config.name}.{axis}_{config.quantity.unit}")
                middle, span = 0.5 * (limits.upper + limits.lower), limits.upper - limits.lower
                self._swings.append((middle * scale, 0.04 * span * scale))

    def stop(self) -> None:
        """No further row; the stream stays open."""
        self._ended.set()
        self.join()

    def run(self) -> None:
        """Until stopped, or until the pipe is closed."""
        with suppress(BrokenPipeError):
            self._pipe.write(",".join(self._names) + "\n")
            while not self._ended.wait(0.05):
                angle = time.monotonic()
                cells = (
                    middle + swing * math.sin(angle + at) for at, (middle, swing) in enumerate(self._swings)
                )
                self._pipe.write(",".join(f"{cell:.4f}" for cell in cells) + "\n")
                self._pipe.flush()
