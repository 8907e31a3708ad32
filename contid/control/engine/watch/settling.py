"""Where the axes of one robot are, and whether they arrive at the last command of a motion.

=========  ==================================================================  =========
state      event                                                               next
=========  ==================================================================  =========
any        a command                                                           commanded
commanded  no more commands; the devices hold, and one is not there: `leave`   settling
commanded  no more commands; they relax, or all are there: `leave`             ended
settling   all are there, or ``settle_s`` is over: `settle`                    ended
=========  ==================================================================  =========

``last`` is None in the first state alone, ``until_s`` is a time in the second alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from contid.control.engine.watch.watched_body import WatchedBody
from contid.hal import Sample
from contid.robot_file.base import Quantity

#: Least time that the axes have to arrive after the last command, and the same in their longest lag.
SETTLE_S: Final = 0.5
SETTLE_LAGS: Final = 5.0


@dataclass(frozen=True, slots=True)
class AxisPlace:
    """Where an axis was commanded to, and measured, in the unit of its column.

    Attributes:
        axis: its column, such as ``left_mm``.
        commanded, measured: the values.
        arrived: the measurement is within the tolerance of the command, or the axis holds.
        holds: it is not, but pushes on something that it may yield to.
    """

    axis: str
    commanded: float
    measured: float
    arrived: bool
    holds: bool = False

    def __str__(self) -> str:
        """For a person."""
        off = self.measured - self.commanded
        held = ", pushes on something" if self.holds else ""
        return (
            f"{self.axis} commanded {self.commanded:.4g}, measured {self.measured:.4g}, off {off:+.3g}{held}"
        )


def has_arrived(places: Sequence[AxisPlace]) -> bool:
    """True when every axis is within the tolerance of its command."""
    return all(place.arrived for place in places)


class Settling:
    """The end of the motions of one robot.

    Attributes:
        settle_s: how long the axes may take to arrive after the last command [s].
        goal: newest command [rad or Pa]; empty before the first.
        last: where the axes were at the end of the last motion.
        until_s: until when they may arrive there.
    """

    def __init__(self, body: WatchedBody) -> None:
        self._body = body
        responses = body.config.responses
        self.settle_s = max(SETTLE_S, *(each.delay_s + SETTLE_LAGS * each.lag_s for each in responses))
        self.goal: tuple[float, ...] = ()
        self.last: list[AxisPlace] | None = None
        self.until_s: float | None = None
        #: Axes that were on their way when the devices took no more commands, and need not arrive.
        self._on_way: list[bool] = []

    def leave(self, samples: Sequence[Sample], holds: bool, now_s: float) -> None:
        """The devices take no commands from now on.

        Devices that hold their goal may still arrive at it; others had to be on their way: those that relax,
        and regulators, which close their valves where the pressure is. A robot that closes on an object was
        not compared.
        """
        body = self._body
        self._on_way = [
            not body.device
            or ((not holds or quantity is Quantity.PRESSURE) and body.is_near_range(i, sample.value))
            for i, (quantity, sample) in enumerate(zip(body.config.quantities, samples, strict=True))
        ]
        self.last = self._left(samples)
        if holds and not (self.last and has_arrived(self.last)):
            self.until_s = now_s + self.settle_s

    def settle(self, samples: Sequence[Sample], now_s: float) -> None:
        """Decide whether the axes arrived, once they did or their time is over."""
        assert self.until_s is not None
        self.last = self._left(samples) or self.last
        if (self.last and has_arrived(self.last)) or now_s >= self.until_s:
            self.until_s = None

    def _left(self, samples: Sequence[Sample]) -> list[AxisPlace]:
        """The places of the axes, of which some had only to be on their way."""
        return [
            replace(place, arrived=place.arrived or on_way)
            for place, on_way in zip(self.places(samples), self._on_way, strict=False)
        ]

    def places(self, samples: Sequence[Sample]) -> list[AxisPlace]:
        """Command and last measurement of every axis; empty before the first of both.

        An axis that is not there has not arrived by a read that failed, which keeps the value before it.
        """
        config, device = self._body.config, self.goal  # [rad or Pa]
        values = [each.value for each in samples if each.value is not None and math.isfinite(each.value)]
        if not device or len(values) < len(device):
            return []
        measured = config.transmission.to_actuation(values)
        commanded = config.transmission.to_actuation(device)
        places = []
        columns = zip(config.axis_names, config.quantities, strict=True)
        axes = zip(columns, commanded, measured, device, samples, config.responses, strict=True)
        for (name, quantity), goal_si, at_si, goal, sample, response in axes:
            off = 0.0 if sample.value is None else goal - sample.value
            near = abs(off) <= response.tolerance
            holds = not near and response.holds(off, sample.effort, self._body.effort_share)
            column = f"{name}_{quantity.unit}"
            places.append(
                AxisPlace(column, quantity.from_si(goal_si), quantity.from_si(at_si), near or holds, holds)
            )
        return places
