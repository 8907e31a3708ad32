"""Detects stalls of the loop: a device that then reports an expired watchdog is not faulty itself.

The time between the starts of two ticks is compared with the period and with the watchdog of the devices; a
replay has the same times. Pure computation on given times.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from contid.control.engine.cycle import Timing
from contid.control.engine.robots import Robots
from contid.control.engine.stages import Targets, TickStage
from contid.control.tick.faults import Fault
from contid.control.tick.robot_tick import TickResult
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode

#: A shorter gap trips no watchdog: `contid.robot_file.tick_rate` refuses shorter ones.
MIN_PERIODS: Final = 2.0
#: Devices report a trip within this time: the state of some is read only now and then.
REPORT_S: Final = 1.0
#: The word by which drivers report a trip (`contid.hal`).
WATCHDOG: Final = "watchdog"


class StallWatch(TickStage):
    """The newest gap between two ticks."""

    def __init__(self, robots: Robots, rate_hz: float) -> None:
        self.robots = range(len(robots.configs))
        self._robots = robots
        self._period_s = 1.0 / rate_hz
        self._started_s = math.nan
        self._gap_s = 0.0
        self._until_s = -math.inf

    def before(self, targets: Targets, timing: Timing, now_s: float) -> Targets:
        """See `TickStage.before`: measures the time since the tick before."""
        start_s = timing.deadline_s + timing.lateness_s
        gap_s = start_s - self._started_s
        expired = start_s > self._until_s
        if gap_s > MIN_PERIODS * self._period_s and (expired or gap_s > self._gap_s):
            self._gap_s, self._until_s = gap_s, start_s + REPORT_S
        elif expired:
            self._gap_s = 0.0
        self._started_s = start_s
        return targets

    def after(self, outcomes: list[TickResult], targets: Targets, now_s: float) -> None:
        """See `TickStage.after`: explains new faults of devices."""
        if not self._gap_s:
            return
        for index, outcome in enumerate(outcomes):
            state = outcome.state
            if state.mode is Mode.FAULT and self._robots.reported[index] is not Mode.FAULT:
                explained = self._explained(state, self._robots.configs[index].watchdog_s)
                outcomes[index] = replace(outcome, state=explained)

    def _explained(self, state: RobotState, watchdog_s: float) -> RobotState:
        """The state with the fault of the loop, when a device tripped because the loop stood still.

        Args:
            state: of the robot.
            watchdog_s: shortest watchdog of its devices [s], 0 when not known.
        """
        # In the tick before the gap the device may have had its instruction up to a period earlier.
        if self._gap_s < watchdog_s - self._period_s:
            return state
        if state.fault is not Fault.DEVICE_FAULT or WATCHDOG not in state.message.lower():
            return state
        message = f"the loop stood still for {self._gap_s * 1e3:.0f} ms: {state.message}"
        return replace(state, fault=Fault.LOOP_STALLED, message=message)
