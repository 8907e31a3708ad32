"""Detects stalls of the loop: a device that then reports an expired watchdog is not faulty itself.

The time between the starts of two ticks is compared with the period and with the watchdog of the devices; a
replay has the same times. Pure computation on given times.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from contid.control.engine.cycle import Timing
from contid.control.tick.faults import Fault
from contid.control.tick.state import RobotState

#: A shorter gap trips no watchdog: `contid.robot_file.tick_rate` refuses shorter ones.
MIN_PERIODS: Final = 2.0
#: Devices report a trip within this time: the state of some is read only now and then.
REPORT_S: Final = 1.0
#: The word by which drivers report a trip (`contid.hal`).
WATCHDOG: Final = "watchdog"


class StallWatch:
    """The newest gap between two ticks."""

    def __init__(self, rate_hz: float) -> None:
        self._period_s = 1.0 / rate_hz
        self._started_s = math.nan
        self._gap_s = 0.0
        self._until_s = -math.inf

    def begin(self, timing: Timing) -> None:
        """A tick starts."""
        start_s = timing.deadline_s + timing.lateness_s
        gap_s = start_s - self._started_s
        expired = start_s > self._until_s
        if gap_s > MIN_PERIODS * self._period_s and (expired or gap_s > self._gap_s):
            self._gap_s, self._until_s = gap_s, start_s + REPORT_S
        elif expired:
            self._gap_s = 0.0
        self._started_s = start_s

    def explained(self, state: RobotState, watchdog_s: float) -> RobotState:
        """The state with the fault of the loop, when a device tripped because the loop stood still.

        Args:
            state: of the robot.
            watchdog_s: shortest watchdog of its devices [s], 0 when not known.
        """
        # In the tick before the gap the device may have had its instruction up to a period earlier.
        if not self._gap_s or self._gap_s < watchdog_s - self._period_s:
            return state
        if state.fault is not Fault.DEVICE_FAULT or WATCHDOG not in state.message.lower():
            return state
        message = f"the loop stood still for {self._gap_s * 1e3:.0f} ms: {state.message}"
        return replace(state, fault=Fault.LOOP_STALLED, message=message)
