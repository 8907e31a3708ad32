"""A driver of others with every defect: a simulated bus until a file appears, then what its option names.

It is installed by an entry point (`installed_in`), so contid isolates it as it does any plug-in.
"""

from __future__ import annotations

import ctypes
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from pydantic import BaseModel

from contid.errors import DeviceLostError
from contid.hal import AxisOnBus, Bus, Clock, DeviceKind, Rest, Sample
from contid_drivers.sim import SimDriver
from contid_drivers.sim.options import SimAxisOptions, SimBusOptions

Samples = Mapping[str, Sample]


def spin() -> None:
    while True:
        pass


#: Processes or threads that one defect starts: more would hurt the machine that tests run on.
MOST = 3
_begun: list[int] = []


def counted() -> bool:
    """True for the first `MOST` calls."""
    _begun.append(0)
    return len(_begun) <= MOST


def forked(do: Callable[[], Any]) -> None:
    if counted() and not os.fork():
        try:
            do()
        finally:
            os._exit(0)


def daemonized() -> None:
    """A process that left group and parent, and computes for ever."""

    def leave() -> None:
        os.setsid()
        forked(spin)

    forked(leave)


def started() -> None:
    if counted():
        threading.Thread(target=spin, daemon=True).start()


def written(descriptor: int) -> None:
    """A flood for a second."""
    end_s = time.monotonic() + 1.0
    while time.monotonic() < end_s:
        os.write(descriptor, b"all is well, really\n" * 200)


def logged() -> None:
    end_s = time.monotonic() + 1.0
    while time.monotonic() < end_s:
        logging.getLogger("bad").warning("all is well, really")


def spun(seconds: float) -> None:
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        pass


def raised(error: BaseException) -> None:
    raise error


def recursed(depth: int = 0) -> int:
    return recursed(depth + 1) + 1


#: Time of an exchange that is too slow [s]: also beside ticks that a busy machine makes ten times as long.
SLOW_S = 0.2
#: What happens in each exchange once it is bad; then the samples are as ever.
DEEDS: dict[str, Callable[[], Any]] = {
    "raise": lambda: raised(ValueError("no idea")),
    "raise lost": lambda: raised(DeviceLostError("box", "it is gone")),
    "raise of its own": lambda: raised(type("Strange", (BaseException,), {})("very")),
    "interrupt": lambda: raised(KeyboardInterrupt()),
    "recursion": recursed,
    "sys.exit": lambda: sys.exit("enough"),
    "exit 0": lambda: os._exit(0),
    "exit in C": lambda: ctypes.CDLL(None).exit(0),
    "segfault": lambda: ctypes.string_at(0),
    "abort": os.abort,
    "another program": lambda: os.execv("/bin/true", ["true"]),
    "SIGKILL": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "SIGTERM": lambda: os.kill(os.getpid(), signal.SIGTERM),
    "SIGSTOP": lambda: os.kill(os.getpid(), signal.SIGSTOP),
    "keeper killed": lambda: os.kill(os.getppid(), signal.SIGKILL),
    "descriptors closed": lambda: os.closerange(0, 256),
    "hang": lambda: time.sleep(1e6),
    "hang in a loop": spin,
    "hang with the GIL": lambda: ctypes.PyDLL(None).sleep(1000),
    "slow": lambda: time.sleep(SLOW_S),
    "slow in a loop": lambda: spun(SLOW_S),
    "slow with the GIL": lambda: ctypes.PyDLL(None).usleep(round(1e6 * SLOW_S)),
    "threads": started,
    "forks": lambda: forked(lambda: time.sleep(1000)),
    "forks that compute": lambda: forked(spin),
    "a daemon": daemonized,
    "two of it": lambda: counted() and os.fork(),
    "flood of stdout": lambda: written(1),
    "flood of stderr": lambda: written(2),
    "flood of logs": logged,
}
#: What is answered instead of the samples.
ANSWERS: dict[str, Callable[[Samples], Any]] = {
    "text": lambda samples: "fine",
    "None": lambda samples: None,
    "NaN": lambda samples: {axis: replace(each, value=float("nan")) for axis, each in samples.items()},
    "text as values": lambda samples: {
        axis: replace(each, value=cast(Any, "far")) for axis, each in samples.items()
    },
    "no samples": lambda samples: {},
    "a long fault": lambda samples: {
        axis: replace(each, fault="x" * 10**7) for axis, each in samples.items()
    },
    "other axes": lambda samples: {f"x{axis}": each for axis, each in samples.items()},
}
KINDS = (*DEEDS, *ANSWERS, "open hangs", "open exits", "disable hangs", "close hangs", "sound")


class BadBusOptions(SimBusOptions):
    """Those of a simulated bus, and the defect."""

    how: str
    trigger: str


class BadBus:
    """The bus."""

    def __init__(self, bus: Bus, options: BadBusOptions) -> None:
        self.name, self.axes = bus.name, bus.axes
        self._bus, self._how, self._trigger = bus, options.how, Path(options.trigger)
        self._opened = 0
        self._looked_s, self._seen = 0.0, False

    @property
    def bad(self) -> bool:
        if not self._seen and time.monotonic() - self._looked_s > 0.05:
            self._looked_s, self._seen = time.monotonic(), self._trigger.exists()
        return self._seen

    def open(self) -> None:
        self._opened += 1
        if self.bad and self._how == "open hangs":
            time.sleep(1e6)
        if self.bad and self._how == "open exits":
            os._exit(0)
        self._bus.open()

    def exchange(self, commands: Mapping[str, float]) -> Any:
        samples = self._bus.exchange(commands)
        if not self.bad:
            return samples
        if self._how in ("open hangs", "open exits"):
            self._bus.close()
            raise DeviceLostError(self.name, "it is gone")
        DEEDS.get(self._how, lambda: None)()
        return ANSWERS.get(self._how, lambda same: same)(samples)

    def enable(self, axes: Sequence[str]) -> None:
        self._bus.enable(axes)

    def disable(self, axes: Sequence[str], rest: Rest) -> None:
        if self.bad and self._how == "disable hangs":
            time.sleep(1e6)
        self._bus.disable(axes, rest)

    def clear_fault(self, axes: Sequence[str]) -> None:
        self._bus.clear_fault(axes)

    def close(self) -> None:
        if self.bad and self._how == "close hangs":
            time.sleep(1e6)
        self._bus.close()


class BadDriver(SimDriver):
    """The driver; `kind`, `address` and the substitutes of ``--mock`` are those of the simulation."""

    bus_options: type[BaseModel] = BadBusOptions
    axis_options: type[BaseModel] = SimAxisOptions

    def kind(self, axis: BaseModel) -> DeviceKind:
        return super().kind(axis)

    def open_bus(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], clock: Clock) -> Bus:
        assert isinstance(options, BadBusOptions)
        return BadBus(super().open_bus(name, options, axes, clock), options)


DRIVER = BadDriver()
#: Environment variable with a file for the ids of the processes that have imported this module.
IMPORTED = "BAD_DRIVER_IMPORTED"
if IMPORTED in os.environ:
    with Path(os.environ[IMPORTED]).open("a") as file:
        file.write(f"{os.getpid()}\n")


def installed_in(folder: Path) -> Path:
    """What ``pip install`` leaves of the driver, in a folder for PYTHONPATH."""
    metadata = folder / "contid_bad-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: contid-bad\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[contid.drivers]\nbad = tests.support.bad_driver:DRIVER\n")
    return folder
