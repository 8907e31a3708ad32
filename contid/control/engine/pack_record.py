"""Packs what a cycle decided into the flat numbers of a record, in the order of its declaration."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from operator import or_
from typing import Final

from contid.control.engine.cycle import Sink, Timing
from contid.control.engine.events.robots import LimitNamed
from contid.control.engine.exchange import Exchange
from contid.control.engine.robots import Robots
from contid.control.engine.tick_layout import (
    AXIS,
    CONVERGED,
    DEADLINE,
    ENABLED,
    HAS_TARGET,
    HEAD,
    LATENESS,
    ROBOT,
    SKIPPED,
    SOURCE_TIME,
    TICK,
    UNRESTED,
    WORK,
)
from contid.control.tick.config import RobotConfig
from contid.control.tick.robot_tick import TickResult
from contid.control.tick.state import RobotState
from contid.hal import Sample
from contid.targets import Actuation, Target

_NAN = math.nan
#: A measurement older than this is not recorded.
MEASURED_MAX_AGE_S: Final = 1.0
_HEAD, _ROBOT, _AXIS = HEAD.blank, ROBOT.blank, AXIS.blank
# Places by name, fetched once.
_MODE, _FAULT, _FLAGS, _LIMITED_BY, _ITERATIONS, _RESIDUAL, _TIP_ERROR, _MEASURED_AGE = map(
    ROBOT.place,
    ("mode", "fault", "flags", "limited_by", "iterations", "residual_m", "tip_error_m", "measured_age_s"),
)
_TIP, _DIRECTION, _X_AXIS, _MID, _LOAD, _MEASURED_TIP, _MEASURED_DIRECTION = map(
    ROBOT.vector, ("tip_m", "direction", "x_axis", "mid_m", "load_n", "measured_tip_m", "measured_direction")
)
_ESTIMATED, _SIGMA = map(ROBOT.vector, ("estimated_load_n", "estimated_sigma_n"))
_TARGET, _SOLUTION, _COMMAND, _DEVICE, _LIMITS, _VALUE, _TIME, _VALID, _AGE = map(
    AXIS.place,
    ("target", "solution", "command", "device", "limits", "value", "time_s", "valid", "age_s"),
)
_VELOCITY, _EFFORT, _TEMPERATURE, _VOLTAGE, _TENSION = map(
    AXIS.place, ("velocity", "effort", "temperature_c", "voltage_v", "tension_n")
)
#: Bits that a float64 of the record keeps exactly.
_MAX_NAMES: Final = 52


class RecordPacker:
    """Packs cycles for a sink; assigns the bits of ``limited_by``.

    Args:
        robots: all of them.
        exchange: with their devices.
        sink: of the records.
        now: the clock of the buses.
    """

    def __init__(self, robots: Robots, exchange: Exchange, sink: Sink, now: Callable[[], float]) -> None:
        self._robots = robots
        self._exchange = exchange
        self._sink = sink
        self._now = now
        self._bits: list[dict[str, int]] = [{} for _ in robots.configs]

    def record(
        self,
        timing: Timing,
        now_s: float,
        source_s: float | None,
        targets: Mapping[str, Target | None],
        outcomes: Sequence[TickResult],
    ) -> None:
        """Write one record, after the exchange.

        Args:
            timing: of the cycle, on the clock of the buses.
            now_s: the time of the robots.
            source_s: time in the trajectory, None while none runs.
            targets: by robot, in the world frame.
            outcomes: of every robot's tick.
        """
        values = [*_HEAD]
        values[TICK], values[SKIPPED] = timing.tick, timing.skipped
        values[DEADLINE], values[LATENESS] = timing.deadline_s, timing.lateness_s
        if source_s is not None:
            values[SOURCE_TIME] = source_s
        for index, config in enumerate(self._robots.configs):
            outcome, state, target = outcomes[index], self._robots.states[index], targets.get(config.name)
            row = self._robot(index, outcome, state, target)
            tip = self._robots.measured.get(config.name)
            if tip is not None and (age_s := now_s - tip.time_s) <= MEASURED_MAX_AGE_S:
                row[_MEASURED_TIP], row[_MEASURED_AGE] = tip.tip_in_world, age_s
                if tip.direction_in_world:
                    row[_MEASURED_DIRECTION] = tip.direction_in_world
            if (load := self._robots.loads.get(config.name)) is not None:
                row[_ESTIMATED], row[_SIGMA] = load
            values += row
            _add_axes(values, config, outcome, state, target, self._exchange.samples)
        values[WORK] = self._now() - timing.deadline_s - timing.lateness_s
        self._sink.write(values)

    def _robot(
        self, index: int, outcome: TickResult, state: RobotState, target: Target | None
    ) -> list[float]:
        row = [*_ROBOT]
        row[_MODE], row[_FAULT] = state.mode, state.fault
        row[_TIP_ERROR] = outcome.tip_error_m
        flags = ENABLED if state.enabled else 0
        if index in self._exchange.unrested:
            flags |= UNRESTED
        solution = outcome.solution
        if solution is not None:
            flags |= CONVERGED if solution.converged else 0
            row[_ITERATIONS], row[_RESIDUAL] = solution.iterations, solution.residual_m
            if solution.limited_by:
                row[_LIMITED_BY] = reduce(or_, [self._bit(index, name) for name in solution.limited_by])
        if target is not None:
            flags |= HAS_TARGET
            if target.tip_m:
                row[_TIP] = target.tip_m
            if target.direction:
                row[_DIRECTION] = target.direction
            if target.rotation:
                row[_X_AXIS], row[_DIRECTION] = target.rotation[0::3], target.rotation[2::3]
            if target.mid_m:
                row[_MID] = target.mid_m
            row[_LOAD] = target.load_n
        row[_FLAGS] = flags
        return row

    def _bit(self, index: int, name: str) -> int:
        """The bit of a limit's name; a new one is announced in an event."""
        bits = self._bits[index]
        if name not in bits:
            number = min(len(bits), _MAX_NAMES)
            bits[name] = 1 << number
            self._sink.event(LimitNamed(robot=self._robots.configs[index].name, bit=number, name=name))
        return bits[name]


def _add_axes(
    values: list[float],
    config: RobotConfig,
    outcome: TickResult,
    state: RobotState,
    target: Target | None,
    samples: Mapping[str, Sample],
) -> None:
    asked: Sequence[float] = ()
    solution = () if outcome.solution is None else outcome.solution.actuation
    if target is not None and (target.actuation is not None or target.arcs or target.extra):
        asked = _asked(config, target, solution)
    command, device, limits = state.command, outcome.device, outcome.limits
    for axis, name in enumerate(config.axes):
        row = [*_AXIS]
        if asked:
            row[_TARGET] = asked[axis]
        if solution:
            row[_SOLUTION] = solution[axis]
        if command:
            row[_COMMAND] = command[axis]
        if device:
            row[_DEVICE] = device[axis]
        if limits:
            row[_LIMITS] = limits[axis]
        if (sample := samples.get(name)) is not None:
            row[_TIME], row[_VALID], row[_AGE] = sample.time_s, sample.valid, sample.age_s
            if sample.value is not None:
                row[_VALUE] = sample.value
            if sample.velocity is not None:
                row[_VELOCITY] = sample.velocity
            if sample.effort is not None:
                row[_EFFORT] = sample.effort
            if sample.temperature_c is not None:
                row[_TEMPERATURE] = sample.temperature_c
            if sample.voltage_v is not None:
                row[_VOLTAGE] = sample.voltage_v
            if sample.tension_n is not None:
                row[_TENSION] = sample.tension_n
        values += row


def _asked(config: RobotConfig, target: Target, solution: Actuation) -> Sequence[float]:
    """The actuation a target gives for every axis, NaN where the model decides; empty for tips alone.

    That of bends is the answer to them.
    """
    own = solution if target.arcs else target.actuation or ()
    if not target.extra and len(own) in (0, len(config.axes)):
        return own
    own = own or (_NAN,) * (len(config.axes) - config.extra_axes)
    return (*own, *(target.extra.get(name, _NAN) for name in config.axis_names[len(own) :]))
