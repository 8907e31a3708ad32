"""How far the axes of a robot are from where their commands should have brought them, from telemetry alone.

The same range as in the tick (`contid.control.tick.follow.expected_range`), with the responses that the
daemon describes. Telemetry has every few ticks only, and commands between two frames are taken as a
straight line: the range is off by at most ``a dt^2 / 8``, for an acceleration ``a`` and frames ``dt`` apart.
At rest it is the command.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from contid.control.tick.config import RobotConfig
from contid.control.tick.follow.expected_range import AxisResponse, ExpectedRange
from contid.remote.protocol.wire import Fields
from contid.targets import Actuation

#: Least step of a range [s]; ticks may be closer together.
STEP_S: Final = 0.01
#: Frames farther apart than this begin a new range [s].
GAP_S: Final = 0.5
#: States of a robot whose devices take commands.
COMMANDED: Final = ("APPROACH", "RUN", "HOLD", "STOPPING")


class Expectation:
    """The axes of one robot, compared with their commands.

    Attributes:
        tolerances: greatest healthy distance of every axis, in its unit.
    """

    def __init__(self, config: RobotConfig, follow: Mapping[str, Mapping[str, Any]]) -> None:
        """Compare the axes of a robot; ``follow`` as the daemon describes it."""
        self._config = config
        responses = zip(follow.values(), config.quantities, strict=True)
        self._responses = tuple(_response(fields, each.unit) for fields, each in responses)
        self.tolerances = [each.tolerance for each in self._responses]
        self._step_s = max(config.period_s, STEP_S)
        self._range = ExpectedRange(self._responses, self._step_s)
        self._newest: tuple[float, ...] = ()
        self._at_s = 0.0
        self._at_fault: Fields | None = None
        #: Bounds of the newest step and the one before: a measurement of a tick answers earlier commands.
        self._lows: Sequence[float] = ()
        self._highs: Sequence[float] = ()

    def compared(self, t_s: float, robot: Mapping[str, Any]) -> Fields | None:
        """What a frame of telemetry shows; None where there is nothing to compare.

        Args:
            t_s: time of the tick.
            robot: fields of the robot: ``state``, ``command``, ``measured``, ``effort``.

        Returns:
            ``off``: measured minus the nearest end of the range, 0 inside, per axis in its unit; ``pushes``:
            per axis, whether it pushes on something and may yield to it; ``at_fault``: this is how it was
            when the robot stopped with a fault.
        """
        command, measured, faulty = robot["command"], robot["measured"], robot["state"] == "FAULT"
        if faulty and not self._newest:
            return self._at_fault
        self._at_fault = None
        if not (faulty or robot["state"] in COMMANDED) or measured is None or None in command:
            self._newest = ()
            return None
        goal, values = self._driven(command), self._driven(measured)
        self._advance(t_s, goal, values)
        bounds = zip(values, self._lows, self._highs, strict=True)
        efforts = zip(self._responses, goal, values, robot.get("effort") or [None] * len(goal), strict=True)
        found = {
            "off": [max(value - high, 0.0) + min(value - low, 0.0) for value, low, high in bounds],
            "pushes": [response.holds(to - at, effort, 1.0) for response, to, at, effort in efforts],
            "at_fault": faulty,
        }
        if faulty:
            self._newest, self._at_fault = (), found
        return found

    def _advance(self, t_s: float, goal: tuple[float, ...], values: Sequence[float]) -> None:
        """The range up to the newest command."""
        before, self._newest = self._newest, goal
        if not before or not 0.0 <= t_s - self._at_s <= GAP_S:
            self._range.begin(goal, values)
            self._lows, self._highs, self._at_s = self._range.lows, self._range.highs, t_s
            return
        steps = round((t_s - self._at_s) / self._step_s)
        for step in range(1, steps + 1):
            self._lows, self._highs = list(self._range.lows), list(self._range.highs)
            share = step / steps
            self._range.advance(tuple([a + share * (b - a) for a, b in zip(before, goal, strict=True)]))
        self._at_s += steps * self._step_s
        self._lows = [min(pair) for pair in zip(self._lows, self._range.lows, strict=True)]
        self._highs = [max(pair) for pair in zip(self._highs, self._range.highs, strict=True)]

    def _driven(self, values: Sequence[float]) -> tuple[float, ...]:
        """What the device of every axis drives, in its unit: with a coupling not the value of its column."""
        config = self._config
        actuation: Actuation = tuple(
            [value / each.per_si for value, each in zip(values, config.quantities, strict=True)]
        )
        devices = zip(
            config.transmission.to_device(actuation), config.transmission.maps, config.quantities, strict=True
        )
        return tuple([to_driven(device) * each.per_si for device, (_, to_driven), each in devices])


def _response(fields: Mapping[str, Any], unit: str) -> AxisResponse:
    """The response of an axis in the unit of its column."""
    times = ("delay", "lag", "overshoot", "least_delay", "least_lag")
    top, pushing_a = fields[f"top_{unit}_s"], fields["pushing_a"]
    return AxisResponse(
        tolerance=fields[f"tolerance_{unit}"],
        top=math.inf if top is None else top,
        jump=math.inf,
        pushing_a=math.inf if pushing_a is None else pushing_a,
        **{f"{each}_s": fields[f"{each}_ms"] / 1e3 for each in times},
    )
