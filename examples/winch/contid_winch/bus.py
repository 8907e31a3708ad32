"""A winch box as a bus of contid: radians outside, steps inside."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from contid.errors import DeviceError, DeviceLostError
from contid.hal import AxisOnBus, Clock, Rest, Sample
from contid_winch import AxisOptions, BusOptions
from contid_winch.link import Link, drum_of

#: A box silent for longer counts as lost.
SILENCE_S: Final = 0.5
#: States of a drum without a fault; every other state is a fault.
WELL: Final = frozenset({"on", "off", "held"})


class WinchBus:
    """See `contid.hal.Bus`."""

    def __init__(self, name: str, options: BusOptions, axes: Sequence[AxisOnBus], clock: Clock) -> None:
        self.name = name
        self.axes = tuple(axis.name for axis in axes)
        self._options = options
        self._given = tuple(axes)
        self._clock = clock
        self._drums = {axis.name: drum_of(axis) for axis in axes}
        self._rad_per_step = {axis.name: rad_per_step(axis) for axis in axes}
        self._link: Link | None = None
        self._lost = "it is not open"
        self._answered_s = 0.0
        self._enabled: set[str] = set()
        self._asked: dict[str, Rest] = {}  # rests that are not confirmed
        self._samples: dict[str, Sample] = {}

    def open(self) -> None:
        """See `contid.hal.Bus.open`."""
        self.close()
        self._link = Link(self.name, self._options, self._given)
        self._answered_s = self._clock.now()
        self._samples = {axis: Sample(None, self._answered_s, False, 0.0) for axis in self.axes}

    def close(self) -> None:
        """See `contid.hal.Bus.close`."""
        self._enabled.clear()
        if self._link is not None:
            self._link.close()
            self._link, self._lost = None, "it is closed"

    def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        """See `contid.hal.Bus.exchange`: one request, one answer."""
        goals = []
        for axis, value in commands.items():
            drum = self._drum(axis)
            if not math.isfinite(value):
                raise DeviceError(axis, f"a command must be finite, got {value!r}")
            if axis in self._enabled:
                goals.append(f"{drum}={round(value / self._rad_per_step[axis])}")
        answer = self._ask(" ".join(["x", *goals]))
        now = self._clock.now()
        if answer is not None:
            self._answered_s = now
        elif now - self._answered_s > SILENCE_S:
            self.close()
            self._lost = f"no answer for {now - self._answered_s:.1f} s"
            raise self._gone()
        answering = _reports(answer or "")
        for axis, drum in self._drums.items():
            if drum in answering:
                steps, state = answering[drum]
                fault = "" if state in WELL else state
                value = steps * self._rad_per_step[axis]
                self._samples[axis] = Sample(value, now, True, 0.0, fault=fault)
            else:
                last = self._samples[axis]
                self._samples[axis] = replace(last, valid=False, age_s=now - last.time_s)
        self._ask_again({drum: state for drum, (_, state) in answering.items()})
        return dict(self._samples)

    def enable(self, axes: Sequence[str]) -> None:
        """See `contid.hal.Bus.enable`; all or nothing."""
        drums = {axis: self._drum(axis) for axis in axes}
        samples = self.exchange({})
        for axis in drums:
            if not samples[axis].valid:
                raise DeviceError(axis, "does not answer", "check its cable")
            if samples[axis].fault:
                raise DeviceError(axis, samples[axis].fault, "clear the fault first")
        new = [axis for axis in drums if axis not in self._enabled]
        if new:
            self._order("on", new)
            self._enabled.update(new)
            for axis in new:
                self._asked.pop(axis, None)

    def disable(self, axes: Sequence[str], rest: Rest) -> None:
        """See `contid.hal.Bus.disable`; ``vent`` relaxes a drum."""
        drums = [str(self._drum(axis)) for axis in axes]
        self._enabled.difference_update(axes)
        self._asked.update(dict.fromkeys(axes, rest))
        if drums and self._link is not None:
            for _ in range(3):
                try:
                    if self._ask(" ".join(["off", _how(rest), *drums])) == "ok":
                        return
                except DeviceLostError:
                    return

    def clear_fault(self, axes: Sequence[str]) -> None:
        """See `contid.hal.Bus.clear_fault`."""
        samples = self.exchange({})
        faulty = [axis for axis in axes if self._drum(axis) and samples[axis].fault]
        if faulty:
            self._order("clear", faulty)
            self._enabled.difference_update(faulty)

    # -- inside ------------------------------------------------------------------------------------------

    def _ask_again(self, states: Mapping[int, str]) -> None:
        """Ask for the rests that the states of the drums do not show yet."""
        for axis, rest in tuple(self._asked.items()):
            state = states.get(self._drums[axis])
            if state == "on" or (state == "held" and rest is not Rest.HOLD):
                self._ask(" ".join(["off", _how(rest), str(self._drums[axis])]))
            elif state is not None:
                del self._asked[axis]

    def _order(self, verb: str, axes: Sequence[str]) -> None:
        """Send an order up to three times, until it is answered; orders are idempotent.

        Raises:
            DeviceError: the box refuses, or does not answer.
        """
        request = " ".join([verb, *(str(self._drums[axis]) for axis in axes)])
        answer = next((reply for _ in range(3) if (reply := self._ask(request)) is not None), None)
        if answer == "ok":
            return
        refused, _, why = (answer or "no").removeprefix("no ").partition(" ")
        named = [axis for axis in axes if str(self._drums[axis]) == refused] or list(axes)
        raise DeviceError(", ".join(named), why or f"no answer to {verb!r}")

    def _ask(self, request: str) -> str | None:
        if self._link is None:
            raise self._gone()
        try:
            return self._link.ask(request)
        except DeviceLostError as lost:
            self.close()
            self._lost = lost.message
            raise

    def _gone(self) -> DeviceLostError:
        return DeviceLostError(self.name, self._lost, "open it again")

    def _drum(self, axis: str) -> int:
        try:
            return self._drums[axis]
        except KeyError:
            raise DeviceError(
                axis, f"no such axis on bus {self.name}; there are {', '.join(self.axes)}"
            ) from None


def _how(rest: Rest) -> str:
    return "hold" if rest is Rest.HOLD else "relax"


def rad_per_step(axis: AxisOnBus) -> float:
    """Angle of one step [rad]."""
    assert isinstance(axis.options, AxisOptions)
    return math.tau / axis.options.steps_per_rev


def _reports(answer: str) -> dict[int, tuple[int, str]]:
    """Position [steps] and state by drum; malformed items are skipped."""
    found = {}
    for item in answer.split():
        drum, _, report = item.partition("=")
        steps, _, state = report.partition(",")
        if drum.isdecimal() and steps.lstrip("-").isdecimal() and state:
            found[int(drum)] = (int(steps), state)
    return found
