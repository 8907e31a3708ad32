"""Homing by effort for any bus: towards an end stop with a bounded push, found twice, a way back between.

The goal runs ahead of the measured position by `EffortStop.lead_deg` at most, so a device whose loop is a
spring pushes no harder than that, and with `EffortStop.effort` for `STILL_S` at most. What stands still
without that effort is a dead encoder or too weak; what does not move back is jammed (`contid.hal.homing`).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from pydantic import BaseModel, Field

from contid.errors import DeviceError
from contid.hal import AxisOnBus, Bus, Clock, Homed, Report, Rest
from contid.hal.homing import BACKOFF_MIN_DEG
from contid_driverkit.clock import MonotonicClock
from contid_driverkit.signals import defer_signals

#: Between two exchanges.
POLL_S: Final = 0.01
#: A stop: no motion for this time while it pushes; without the effort, for the longer one.
STILL_S: Final = 0.25
FROZEN_S: Final = 0.8
#: Motion: more than this.
MOVED_RAD: Final = math.radians(0.15)
#: A device that does not answer for this time ends the search.
SILENT_S: Final = 0.3
#: Longest search, in multiples of the time that ``travel_deg`` takes at the speed of the search. The goal
#: waits for a device that is slower; a position that only jitters would keep the search up for ever.
LONGEST_SEARCH: Final = 4.0


class EffortStop(BaseModel, extra="forbid", frozen=True, allow_inf_nan=False):
    """Keys ``homing`` of an axis that is homed by `home_by_effort`.

    Attributes:
        direction: sense of the device's rotation towards the stop.
        effort: effort at the stop, in the unit that the driver reports (A for servos); 0 for a device that
            reports none: then a standstill alone counts.
        speed_deg_s: speed of the search.
        lead_deg: farthest that the goal is ahead of the position.
        backoff_deg: way back from the stop; 3 degrees at least.
        travel_deg: longest way to the stop; it limits the time of a search as well (`LONGEST_SEARCH`).
        at_mm: length of the actuator at the stop.
    """

    direction: Literal[1, -1]
    effort: Annotated[float, Field(ge=0)]
    speed_deg_s: Annotated[float, Field(gt=0, le=180)] = 20.0
    lead_deg: Annotated[float, Field(gt=0, le=30)] = 5.0
    backoff_deg: Annotated[float, Field(ge=0)] = 5.0
    travel_deg: Annotated[float, Field(gt=0)] = 360.0
    at_mm: float = 0.0


class HomesByEffort(ABC):
    """A driver that homes by effort (`contid.hal.Homes`) axes with an `EffortStop`, ``homing``."""

    @abstractmethod
    def open_bus(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], clock: Clock) -> Bus:
        """See `contid.hal.Driver.open_bus`."""

    def home(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], only: Sequence[str], report: Report
    ) -> list[Homed]:
        """See `contid.hal.Homes.home`."""
        clock = MonotonicClock()
        return home_by_effort(self.open_bus(name, options, axes, clock), axes, only, clock, report)


def home_by_effort(
    bus: Bus, axes: Sequence[AxisOnBus], only: Sequence[str], clock: Clock, report: Report
) -> list[Homed]:
    """Find the stops of axes one after the other; for `contid.hal.Homes.home`.

    Args:
        bus: not open; it is closed afterwards, all of ``only`` relaxed.
        axes: every axis of the bus; the options of those in ``only`` have ``homing``, an `EffortStop`.
        only: names of the axes to home.
        clock: of the bus.
        report: takes lines about the progress.

    Raises:
        DeviceError: an axis has no homing, or its reference was not found twice.
    """
    chosen = [axis for axis in axes if axis.name in only]
    for axis in chosen:
        if not isinstance(getattr(axis.options, "homing", None), EffortStop):
            raise DeviceError(axis.name, "it has no homing", "add `homing: {direction: ..., effort: ...}`")
    with closing(bus):
        bus.open()
        try:
            return [_home_one(bus, axis, clock, report) for axis in chosen]
        finally:
            with defer_signals():
                bus.disable(list(only), Rest.RELAX)


def _home_one(bus: Bus, axis: AxisOnBus, clock: Clock, report: Report) -> Homed:
    how: EffortStop = axis.options.homing  # type: ignore[attr-defined]  # checked by its caller
    search, name = _Search(bus, axis.name, how, clock), axis.name
    start = search.look().value
    bus.enable([name])
    try:
        report(f"{name}: towards its stop at {how.speed_deg_s:g} deg/s")
        first = search.until_blocked()
        report(f"{name}: stands still at {math.degrees(first):.2f} deg, once more")
        back = math.radians(max(how.backoff_deg, BACKOFF_MIN_DEG))
        axis.reference.require_way_back(name, search.move_back(first, back), back)
        stop = search.until_blocked()
        axis.reference.require_repetition(name, first, stop)
        axis.reference.require_way_back(name, search.move_back(stop, back), back)
    finally:
        with defer_signals():
            bus.disable([name], Rest.RELAX)
    # No `contid.hal.Sample` shows that a device has lost its count of turns: the whole angle must agree.
    axis.reference.require_former(name, stop, turns_lost=False)
    report(f"{name}: stop at {math.degrees(stop):.2f} deg")
    way = math.degrees(abs(first - start))
    return Homed(
        name, stop, how.at_mm, f"stop at an effort of {how.effort:g} after {way:.0f} deg, found twice"
    )


@dataclass(frozen=True, slots=True)
class _Place:
    """A valid answer of the searching device."""

    value: float
    effort: float | None


@dataclass(slots=True)
class _Search:
    """Goals and answers of one axis while it searches."""

    bus: Bus
    name: str
    how: EffortStop
    clock: Clock

    def look(self, goal: float | None = None) -> _Place:
        """Send a goal, and wait for a valid answer.

        Raises:
            DeviceError: a fault of the device, or silence.
        """
        until = self.clock.now() + SILENT_S
        while True:
            sample = self.bus.exchange({} if goal is None else {self.name: goal})[self.name]
            if sample.fault:
                raise DeviceError(
                    self.name, f"{sample.fault}, while homing", "remove its cause, then home again"
                )
            if sample.valid and sample.value is not None:
                return _Place(sample.value, sample.effort)
            if self.clock.now() > until:
                raise DeviceError(self.name, "it does not answer while homing", "check its cable and supply")
            self.clock.sleep(POLL_S)

    def until_blocked(self) -> float:
        """Go towards the stop; where it stands still with the effort [rad].

        Raises:
            DeviceError: no stop on the way or in time, or a standstill without the effort.
        """
        how = self.how
        speed, lead, travel = (math.radians(each) for each in (how.speed_deg_s, how.lead_deg, how.travel_deg))
        start = place = self.look().value
        begun = self.clock.now()
        goal, before = place, begun
        moved_at, pushed_at, moved_from = begun, begun, place
        while True:
            self.clock.sleep(POLL_S)
            now = self.clock.now()
            # The goal advances at the speed, never behind the position, nor ahead by more than the lead.
            goal += how.direction * speed * (now - before)
            ahead = min(max((goal - place) * how.direction, 0.0), lead)
            goal, before = place + how.direction * ahead, now
            found = self.look(goal)
            place = found.value
            if abs(place - moved_from) > MOVED_RAD:
                moved_at, moved_from = now, place
            if not self._pushes(found, ahead >= lead):
                pushed_at = now
            if now - max(moved_at, pushed_at) >= STILL_S:
                return place
            way = math.degrees(abs(place - start))
            if now - moved_at > FROZEN_S + lead / speed:
                raise DeviceError(
                    self.name,
                    f"it stands still with an effort of {abs(found.effort or 0.0):.3g}, below {how.effort:g}",
                    "its encoder is dead, or `effort` of its homing is more than it reaches: raise lead_deg",
                )
            if way > how.travel_deg or now - begun > FROZEN_S + LONGEST_SEARCH * travel / speed:
                raise DeviceError(
                    self.name,
                    f"no stop within {way:.0f} deg and {now - begun:.1f} s",
                    "check direction, effort and travel_deg of its homing; its encoder must not jitter",
                )

    def _pushes(self, found: _Place, leads: bool) -> bool:
        if found.effort is None or self.how.effort == 0.0:
            return leads
        return abs(found.effort) >= self.how.effort

    def move_back(self, stop: float, back: float) -> float:
        """Move away from a stop; the way that was measured [rad]."""
        direction = self.how.direction
        end = stop - direction * back
        speed, lead = math.radians(self.how.speed_deg_s), math.radians(self.how.lead_deg)
        before = moved_at = self.clock.now()
        until = before + back / speed + FROZEN_S
        goal = place = moved_from = stop
        while (now := self.clock.now()) < until and now - moved_at < FROZEN_S:
            self.clock.sleep(POLL_S)
            now = self.clock.now()
            # As towards the stop, by the ways left to the end: the goal goes on at the speed, never behind
            # the position, nor ahead of it by more than the lead, nor beyond the end.
            left = (place - end) * direction
            goal_left = min((goal - end) * direction - speed * (now - before), left)
            goal, before = end + direction * max(goal_left, left - lead, 0.0), now
            place = self.look(goal).value
            if abs(place - moved_from) > MOVED_RAD:
                moved_at, moved_from = self.clock.now(), place
            if abs(place - end) <= MOVED_RAD / 2.0:
                break
        return (stop - place) * direction
