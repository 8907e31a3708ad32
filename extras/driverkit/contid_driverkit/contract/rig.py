"""A bus under test, and the powers over the devices behind it that the contract tests need.

A rig opens nothing by itself: it gives a bus that was never opened, with two axes or more at rest, and
handles to what stands behind the wire. Simulated buses run in virtual time, emulators and
firmware in real time, so the tests express durations by `BusUnderTest.pump` and `BusUnderTest.wait` only.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Protocol

from contid.hal import Bus, DeviceKind, Rest, Sample

#: Between two exchanges of `BusUnderTest.pump`.
TICK_S: Final = 0.005
#: Silence of the host for devices without a watchdog.
SILENCE_S: Final = 0.2


@dataclass(frozen=True, slots=True)
class Facts:
    """What is true of the devices behind a bus, in rad or Pa and s.

    Attributes:
        kind: kind of actuator of every axis.
        still: two looks at a device at rest differ by less, seen from the device itself (one step of it).
        reading: a sample differs from the device by less (noise and quantisation).
        near: distance that any axis covers and settles within ``settle_s``, well above ``reading``.
        far: distance that takes much longer than ``silence_s`` and ``settle_s`` together.
        settle_s: time for ``near``, and for any device to come to rest after `disable`.
        watchdog_s: the watchdog of the devices; None declares that they have none, and go on to their last
            goal when the host dies.
        vent_s: time to lose all pressure from ``near`` above the start; 0 for other kinds.
        on_watchdog: what the device does when its watchdog trips.
    """

    kind: DeviceKind
    still: float
    reading: float
    near: float
    far: float
    settle_s: float
    watchdog_s: float | None
    vent_s: float = 0.0
    on_watchdog: Rest = Rest.HOLD

    @property
    def silence_s(self) -> float:
        """A silence of the host that trips the watchdog, where there is one."""
        return SILENCE_S if self.watchdog_s is None else self.watchdog_s


class BusUnderTest(Protocol):
    """A bus and the powers a test needs over the world behind it."""

    @property
    def bus(self) -> Bus:
        """The bus."""
        ...

    @property
    def facts(self) -> Facts:
        """What is true of its devices."""
        ...

    def pump(self, seconds: float, commands: Mapping[str, float] | None = None) -> Mapping[str, Sample]:
        """Exchange at the bus's usual rate for that long, at least once; the last answer comes back."""
        ...

    def wait(self, seconds: float) -> None:
        """Let time pass without any traffic."""
        ...

    def value(self, axis: str) -> float:
        """Where the device really is [rad or Pa], asked beside the bus."""
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


def values(rig: BusUnderTest, axes: Iterable[str] | None = None) -> dict[str, float]:
    """Where axes really are, every one unless some are named."""
    return {axis: rig.value(axis) for axis in (rig.bus.axes if axes is None else axes)}


def offset(rig: BusUnderTest, axes: Iterable[str], distance: float) -> dict[str, float]:
    """Commands that far above where each axis really is."""
    return {axis: value + distance for axis, value in values(rig, axes).items()}
