"""What follows from the tick of a robot: new state, requests to devices, end of a goto, statistics."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import reduce
from operator import or_
from typing import Final

from contid.control.engine.cycle import Sink
from contid.control.engine.events.robots import GotoEnded, SqueezeChanged
from contid.control.engine.exchange import Exchange
from contid.control.engine.robots import Robots
from contid.control.engine.sources import Timed
from contid.control.engine.target_selector import TargetSelector
from contid.control.engine.watch.arrivals import Arrivals
from contid.control.tick.config import RobotConfig
from contid.control.tick.preflight.reasons import NEAR_M
from contid.control.tick.robot_tick import TickResult
from contid.control.tick.squeezing import SqueezeEnd, SqueezeReport
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.targets import Target

#: Messages of the event of a squeeze.
_SQUEEZED: Final = {
    SqueezeEnd.REACHED: "holds with {:.2f} N",
    SqueezeEnd.LOST: "lost the object ({:.2f} N left); it holds where it is",
    SqueezeEnd.NOTHING: "at the target without the force ({:.2f} N); it holds there",
    SqueezeEnd.PRESSED: "no free way of 2 mm to measure friction on: move back from the object; it holds",
    SqueezeEnd.WEAK: "friction may hide {:.2f} N on this way, more than the force to hold; it stays there",
}


class Outcomes:
    """Takes over the results of ticks."""

    def __init__(
        self,
        robots: Robots,
        selector: TargetSelector,
        exchange: Exchange,
        going_back: Mapping[int, Target | None],
        arrivals: Arrivals,
        sink: Sink,
    ) -> None:
        """``going_back``: see `contid.control.engine.stages.ReactsToContacts`."""
        self._robots = robots
        self._selector = selector
        self._exchange = exchange
        self._going_back = going_back
        self._arrivals = arrivals
        self._sink = sink
        #: Goto of each robot at the last look (`end_replaced`).
        self._going: list[Target | None] = [None for _ in robots.configs]

    def end_replaced(self, number: int) -> None:
        """After an order and before the results of a tick: the gotos that another one, or none, replaced end.

        Several orders may come between two ticks, so that no tick sees some of their gotos. The gotos of a
        robot end in their order: clients know them by it.
        """
        for index, state in enumerate(self._robots.states):
            if index in self._going_back and (state.goto is None or state.goto is self._going_back[index]):
                continue
            before = self._going[index]
            if state.goto is not None and state.goto is not before:
                self._arrivals.replaced(index, number)
            if before is not None and before is not state.goto:
                name = self._robots.configs[index].name
                self._sink.event(GotoEnded(robot=name, arrived=False, tick=number))
            self._going[index] = None if state.recovering else state.goto

    def take(self, index: int, number: int, outcome: TickResult, target: Target | None) -> None:
        """Take over the tick of a robot; queues its request to the devices and reports the end of a goto."""
        robots = self._robots
        config, state, tally = robots.configs[index], robots.states[index], robots.tallies[index]
        going, recovered = state.goto, state.recovering
        retreating = index in self._going_back
        state = outcome.state
        if state.pending:
            state = self._exchange.requests.ask(index, state)
        if outcome.squeezed is not None:
            self._sink.event(_squeeze_event(config, number, outcome.squeezed))
        if going is not None and state.goto is None and not recovered:
            arrived = state.mode is Mode.HOLD and not retreating and outcome.arrived
            if arrived and outcome.squeezed is None:
                self._arrivals.commanded(index)
            else:
                self._sink.event(GotoEnded(robot=config.name, arrived=arrived, tick=number))
        if not retreating or (going is not None and state.goto is None):
            self._going[index] = None if state.recovering else state.goto
        robots.states[index] = state
        tally.approached += state.mode is Mode.APPROACH
        if outcome.solution is not None:
            source = self._selector.source
            timed = source is not None and source.time_s is not None
            tally.add(outcome.tip_error_m, outcome.solution.converged, outcome.solution.residual_m)
            if outcome.solution.converged or outcome.solution.residual_m <= NEAR_M:
                off_m = outcome.tip_error_m - outcome.solution.residual_m
                tally.on_path(off_m, state.command != state.reference, timed, state.since_s)
            else:  # the nearest point, which may jump
                tally.off_path(_behind_m(config, state, target))
                # A correction by measured tips may lead out of the reach that was checked.
                if isinstance(source, Timed) and source.within_reach and not config.measurements_move_targets:
                    tally.missed(outcome.solution.residual_m)
        if bits := reduce(or_, outcome.limits, 0):
            tally.limited[bits] += 1


def _squeeze_event(config: RobotConfig, number: int, report: SqueezeReport) -> SqueezeChanged:
    return SqueezeChanged(
        tick=number,
        robot=config.name,
        what=report.end.value,
        force_n=round(report.force_n, 4),
        message=_SQUEEZED[report.end].format(report.force_n),
    )


def _behind_m(config: RobotConfig, state: RobotState, target: Target | None) -> float:
    """Distance of the commanded tip from that of the model's answer [m]."""
    if target is None or state.command == state.reference:
        return 0.0
    forward, load_n = config.model.forward, config.frame.vector_in_base(target.load_n)
    try:
        return math.dist(forward(state.command, load_n).tip_m, forward(state.reference, load_n).tip_m)
    except Exception:  # only a figure of the report; the next tick reports the defect of the model
        return 0.0
