"""Interface of the contract tests to a bus under test; one harness per driver and kind of device.

A harness opens nothing by itself: it gives a bus that was never opened, with two axes or more at rest, and
handles to what stands behind the wire. Simulated buses run in virtual time, emulators and firmware in real
time, so the suite speaks of durations only through `pump` and `wait`.

To hold a further driver to the contract, write a context manager that yields a `BusUnderTest` and name it in
`HARNESSES`, or, for a driver of another distribution, in the environment: ``CONTID_HARNESS=module:function``.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib import import_module
from typing import Final, Protocol

from contid.hal import Bus, DeviceKind, Rest, Sample

#: Between two exchanges of `BusUnderTest.pump`.
TICK_S: Final = 0.005


@dataclass(frozen=True)
class Facts:
    """What is true of the devices behind a bus, in rad or Pa and s.

    Attributes:
        kind: kind of actuator of every axis.
        still: two looks at a device at rest differ by less, seen from the device itself (one step of it).
        reading: a sample differs from the device by less (noise and quantisation).
        near: distance that any axis covers and settles within ``settle_s``, well above ``reading``.
        far: distance that takes much longer than ``watchdog_s`` and ``settle_s`` together.
        settle_s: time for ``near``, and for any device to come to rest after `disable`.
        watchdog_s: the watchdog.
        vent_s: time to lose all pressure from ``near`` above the start; 0 for other kinds.
        on_watchdog: what the device does when it trips.
    """

    kind: DeviceKind
    still: float
    reading: float
    near: float
    far: float
    settle_s: float
    watchdog_s: float
    vent_s: float
    on_watchdog: Rest


class BusUnderTest(Protocol):
    """A bus and the powers a test needs over the world behind it."""

    bus: Bus
    facts: Facts

    def pump(self, seconds: float, commands: Mapping[str, float] | None = None) -> Mapping[str, Sample]:
        """Exchange at the bus's usual rate for that long, at least once; the last answer comes back."""
        ...

    def wait(self, seconds: float) -> None:
        """Let time pass without any traffic."""
        ...

    def value(self, axis: str) -> float:
        """Where the device really is [rad or Pa], asked behind the bus's back."""
        ...

    def powered(self, axis: str) -> bool:
        """Whether the device holds or moves by its own force: torque on, or regulator active."""
        ...

    def silence(self, axis: str, silent: bool) -> None:
        """Make one axis neither receive nor answer, or end that."""
        ...

    def unplug(self) -> None:
        """Take the whole bus away from the host; the devices stay under power."""
        ...

    def plug(self) -> None:
        """Bring it back."""
        ...

    def break_device(self, axis: str) -> None:
        """Make a device report a latched fault of its own and drop its torque or pressure."""
        ...

    def repair_device(self, axis: str) -> None:
        """End the cause of that fault; the latch stays."""
        ...


class RealTimeRig:
    """How time passes for a bus whose devices are emulated in real time; a base of the rigs of such buses."""

    bus: Bus

    def pump(self, seconds: float, commands: Mapping[str, float] | None = None) -> Mapping[str, Sample]:
        """See `BusUnderTest.pump`."""
        until = time.monotonic() + seconds
        while True:
            samples = self.bus.exchange(commands or {})
            if time.monotonic() >= until:
                return samples
            time.sleep(TICK_S)

    def wait(self, seconds: float) -> None:
        """See `BusUnderTest.wait`."""
        time.sleep(seconds)


#: Name in the test's id -> "module:function"; the function is a context manager without arguments.
HARNESSES: Final[dict[str, str]] = {
    "due-motor": "tests.contract.due_harness:motors",
    "due-regulator": "tests.contract.due_harness:regulators",
    "dynamixel": "tests.contract.dynamixel_harness:servo",
    "sim-servo": "tests.contract.sim_harness:servo",
    "sim-motor": "tests.contract.sim_harness:motor",
    "sim-regulator": "tests.contract.sim_harness:regulator",
    "winch": "winch_harness:winch",
}
if foreign := os.environ.get("CONTID_HARNESS"):
    HARNESSES[foreign.partition(":")[0]] = foreign


def harness(name: str) -> AbstractContextManager[BusUnderTest]:
    """The harness called ``name``; imports only that one."""
    module, _, function = HARNESSES[name].partition(":")
    made: AbstractContextManager[BusUnderTest] = getattr(import_module(module), function)()
    return made


def offset(rig: BusUnderTest, axes: Sequence[str], distance: float) -> dict[str, float]:
    """Commands that far above where each axis really is."""
    return {axis: rig.value(axis) + distance for axis in axes}
