"""Time that goes on while a host waits for its devices: nothing is ever late.

It stands for the modules `time` and `select` in drivers whose devices are emulated in the same thread.
"""

from __future__ import annotations

import select
from collections.abc import Iterable, Sequence
from types import ModuleType
from typing import Protocol

import pytest

#: What a look at the clock takes [s]: a loop that only looks ends, too.
LOOK_S = 1e-6


class Emulated(Protocol):
    """Devices behind pseudo terminals."""

    def turn(self, now_s: float) -> None:
        """Come to a time, and answer what has come."""


class WireTime:
    """The time of hosts and devices.

    Attributes:
        devices: that live in it.
        longest_s: of one step, after which devices may answer.
    """

    def __init__(self, longest_s: float) -> None:
        self.devices: Sequence[Emulated] = ()
        self.longest_s = longest_s
        self._now_s = 1000.0

    def now(self) -> float:
        """As the clock of a bus."""
        return self.monotonic()

    def monotonic(self) -> float:
        """As `time.monotonic`."""
        self._now_s += LOOK_S
        return self._now_s

    def sleep(self, seconds: float) -> None:
        """As `time.sleep`."""
        until_s = self._now_s + max(0.0, seconds)
        while self._now_s < until_s:
            self._now_s = min(self._now_s + self.longest_s, until_s)
            self._turn()

    def select(
        self, read: Sequence[int], write: Sequence[int], _failed: object, wait_s: float
    ) -> tuple[list[int], list[int], list[int]]:
        """As `select.select`."""
        until_s = self._now_s + wait_s
        self._turn()
        while not any(found := select.select(read, write, [], 0.0)) and self._now_s < until_s:
            self._now_s = min(self._now_s + self.longest_s, until_s)
            self._turn()
        return found[0], found[1], []

    def _turn(self) -> None:
        for each in self.devices:
            each.turn(self._now_s)


def wire_time(
    monkeypatch: pytest.MonkeyPatch,
    timed: Iterable[ModuleType],
    selecting: Iterable[ModuleType],
    longest_s: float = 10.0,
) -> WireTime:
    """A time for modules that use `time`, and `select`, until the test ends."""
    made = WireTime(longest_s)
    for module in timed:
        monkeypatch.setattr(module, "time", made)
    for module in selecting:
        monkeypatch.setattr(module, "select", made)
    return made
