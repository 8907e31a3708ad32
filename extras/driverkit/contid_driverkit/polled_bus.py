"""A bus that keeps the contract; its driver reads, sends goals and switches power.

For devices that are asked in every tick and that hold the goal they were sent last: bus servos, drives on a
field bus. Enabled axes, latched faults, lost ports and confirmed power are the same for all of them.
"""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Final

from contid.errors import DeviceError, DeviceLostError
from contid.hal import AxisOnBus, Clock, Rest, Sample

log = logging.getLogger(__name__)

#: Orders are sent until an answer confirms them, at most so often.
ATTEMPTS: Final = 6
LOST_TORQUE: Final = "torque lost: it was reset, or another program switched it off"


@dataclass(frozen=True, slots=True)
class Reading:
    """What one device answered.

    Attributes:
        value: position [rad] or pressure [Pa].
        powered: its torque, or its regulator, is on.
        fault: its present fault, "" without one.
        goal: the goal that it was sent last, rounded as ``value`` is. None when it does not report it: then
            power does not wait for it, and a goal that is lost on the wire is a jump.
        velocity, effort, temperature_c, voltage_v: as in `contid.hal.Sample`.
    """

    value: float
    powered: bool
    fault: str = ""
    goal: float | None = None
    velocity: float | None = None
    effort: float | None = None
    temperature_c: float | None = None
    voltage_v: float | None = None


@dataclass(slots=True)
class _AskedRest:
    """A rest that a device has not confirmed, and where it is to hold [rad or Pa], once that was read."""

    rest: Rest
    goal: float | None = None


class PolledBus(ABC):
    """See `contid.hal.Bus`; a driver defines the abstract methods, and calls none of the others."""

    def __init__(self, name: str, axes: Sequence[AxisOnBus], clock: Clock) -> None:
        self.name = name
        self.axes = tuple(axis.name for axis in axes)
        self._clock = clock
        self._lost: DeviceLostError | None = DeviceLostError(name, "the bus is not open")
        self._enabled: set[str] = set()
        self._latched: dict[str, str] = {}
        self._asked: dict[str, _AskedRest] = {}
        self._samples: dict[str, Sample] = {}

    @abstractmethod
    def connect(self) -> None:
        """Open the port and check that every device is there; moves and switches nothing.

        Raises:
            DeviceNotFoundError: the port or a device is missing, or differs from the robot file.
        """

    @abstractmethod
    def disconnect(self) -> None:
        """Close the port; idempotent, also on a dead port."""

    @abstractmethod
    def read(self) -> Mapping[str, Reading]:
        """Ask every device once, and take the answers until their time-out; feeds watchdogs.

        Raises:
            DeviceLostError: the port is gone.
        """

    @abstractmethod
    def send(self, goals: Mapping[str, float]) -> None:
        """Send goals [rad or Pa]; raises `DeviceLostError` as `read` does."""

    @abstractmethod
    def power(self, axes: Collection[str], on: bool) -> None:
        """Switch power, at the goal that was sent last; `read` confirms it. Raises as `read` does."""

    def open(self) -> None:
        """See `contid.hal.Bus.open`."""
        self.close()
        try:
            self.connect()
        except BaseException:
            self.disconnect()
            raise
        self._lost = None
        self._samples = {axis: Sample(None, self._clock.now(), False, 0.0) for axis in self.axes}

    def close(self) -> None:
        """See `contid.hal.Bus.close`."""
        self._lose(DeviceLostError(self.name, "the bus is closed"))

    def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        """See `contid.hal.Bus.exchange`."""
        self._require_axes(commands)
        for axis, value in commands.items():
            if not math.isfinite(value):
                raise DeviceError(axis, f"a command must be finite, got {value!r}")
        found = self._look({axis: value for axis, value in commands.items() if axis in self._enabled})
        if self._asked:
            self._rest(found, found)
            self._drop_unreported(found)
        return dict(self._samples)

    def enable(self, axes: Sequence[str]) -> None:
        """See `contid.hal.Bus.enable`: goal := present, confirmed, then power; all or nothing."""
        self._require_axes(axes)
        new = [axis for axis in axes if axis not in self._enabled]
        goals: dict[str, float] = {}
        limp: list[str] = []  # others hold something, and keep their power whatever happens
        why = "its power does not switch on"
        try:
            for _ in range(ATTEMPTS):
                found = self._look({})
                for axis in axes:
                    self._require_well(axis, found)
                if not goals:
                    goals = {axis: found[axis].value for axis in new}
                    limp = [axis for axis in new if not found[axis].powered]
                    sent = not goals
                else:
                    sent = all(_has_goal(found[axis], goal) for axis, goal in goals.items())
                if sent and all(found[axis].powered for axis in new):
                    self._enabled.update(new)
                    for axis in new:
                        self._asked.pop(axis, None)
                    return
                why = "its power does not switch on" if sent else "it does not take its goal"
                with self._reaching():
                    if sent:
                        self.power(limp, True)
                    else:
                        self.send(goals)
            raise DeviceError(", ".join(new), why, "check its supply and cable")
        except DeviceLostError:
            raise
        except DeviceError:
            if limp:
                with self._reaching():
                    self.power(limp, False)
            raise

    def disable(self, axes: Sequence[str], rest: Rest) -> None:
        """See `contid.hal.Bus.disable`; a powered axis holds where it is, or loses its power."""
        self._require_axes(axes)
        self._enabled.difference_update(axes)
        self._asked.update({axis: _AskedRest(rest) for axis in axes})
        try:
            for _ in range(ATTEMPTS):
                found = self._look({})
                self._rest(found, axes)
                if self._asked.keys().isdisjoint(axes):
                    return
            self._drop_unreported(found)
            if silent := [axis for axis in axes if axis in self._asked]:
                what = "hold" if rest is Rest.HOLD else "power off"
                log.warning("%s: %s is not confirmed by %s", self.name, what, ", ".join(silent))
        except DeviceLostError:
            return

    def clear_fault(self, axes: Sequence[str]) -> None:
        """See `contid.hal.Bus.clear_fault`."""
        self._require_axes(axes)
        found = self._look({})
        for axis in axes:
            if axis not in found:
                raise DeviceError(axis, "does not answer", "check its cable")
            if axis in self._latched and found[axis].fault:
                raise DeviceError(axis, found[axis].fault, "remove its cause first")
        for axis in axes:
            self._latched.pop(axis, None)

    # -- inside ------------------------------------------------------------------------------------------

    def _look(self, goals: Mapping[str, float]) -> Mapping[str, Reading]:
        """Send goals, read every device, and switch off the faulty ones."""
        with self._reaching():
            if goals:
                self.send(goals)
            found = self.read()
            self._take(found)
            if faulty := [axis for axis in self._latched if axis in found and found[axis].powered]:
                self.power(faulty, False)
        return found

    def _take(self, found: Mapping[str, Reading]) -> None:
        """New samples, and new faults."""
        now = self._clock.now()
        for axis in self.axes:
            each, last = found.get(axis), self._samples[axis]
            if each is None:
                self._samples[axis] = replace(last, valid=False, age_s=now - last.time_s)
                continue
            lost = LOST_TORQUE if axis in self._enabled and not each.powered else ""
            if (fault := each.fault or lost) and axis not in self._latched:
                log.error("%s: %s", axis, fault)
                self._latched[axis] = fault
                self._enabled.discard(axis)
            self._samples[axis] = Sample(
                each.value, now, True, 0.0, each.velocity, each.effort, each.temperature_c, each.voltage_v,
                self._latched.get(axis, ""),
            )  # fmt: skip

    def _rest(self, found: Mapping[str, Reading], axes: Collection[str]) -> None:
        """Send the rests of ``axes`` that ``found`` does not confirm; those that it confirms are done."""
        goals: dict[str, float] = {}
        off: list[str] = []
        for axis, asked in self._asked.items():
            if axis not in found:
                asked.goal = None  # it may be moved until it answers
        for axis in [axis for axis in axes if axis in self._asked]:
            each, asked = found.get(axis), self._asked[axis]
            if each is not None and not each.powered:
                del self._asked[axis]
            elif asked.rest is not Rest.HOLD:
                off.append(axis)
            elif each is None:
                continue
            elif asked.goal is not None:
                if _has_goal(each, asked.goal, False):
                    del self._asked[axis]
                else:
                    goals[axis] = asked.goal
            else:
                asked.goal = goals[axis] = each.value
        with self._reaching():
            if goals:
                self.send(goals)
            if off:
                self.power(off, False)

    def _drop_unreported(self, found: Mapping[str, Reading]) -> None:
        """A device that reports no goal cannot confirm that it holds, once that was sent to it."""
        for axis, asked in tuple(self._asked.items()):
            sent = asked.rest is Rest.HOLD and asked.goal is not None
            if sent and axis in found and found[axis].goal is None:
                del self._asked[axis]

    @contextmanager
    def _reaching(self) -> Iterator[None]:
        """Around what needs the port; one that is lost stays lost until `open`."""
        if self._lost is not None:
            raise DeviceLostError(self.name, self._lost.message, self._lost.remedy)
        try:
            yield
        except DeviceLostError as lost:
            self._lose(lost)
            raise

    def _lose(self, lost: DeviceLostError) -> None:
        for asked in self._asked.values():
            asked.goal = None
        self._enabled.clear()
        self._latched.clear()
        self.disconnect()
        self._lost = lost

    def _require_axes(self, axes: Iterable[str]) -> None:
        for axis in axes:
            if axis not in self.axes:
                known = ", ".join(self.axes)
                raise DeviceError(axis, f"no such axis on bus {self.name}; there are {known}")

    def _require_well(self, axis: str, found: Mapping[str, Reading]) -> None:
        if axis not in found:
            raise DeviceError(axis, "does not answer", "check its cable")
        if axis in self._latched:
            raise DeviceError(axis, self._latched[axis], "clear the fault first")


def _has_goal(reading: Reading | None, goal: float, unreported: bool = True) -> bool:
    """Whether a device confirms a goal; ``unreported`` for one that does not report it."""
    if reading is None or reading.goal is None:
        return unreported
    return math.isclose(reading.goal, goal, rel_tol=1e-9, abs_tol=1e-9)
