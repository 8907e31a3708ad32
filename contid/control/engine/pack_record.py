"""From what a cycle decided to the flat list of numbers of a record."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from contid.control.engine.cycle import Sink, Timing
from contid.control.engine.tick_layout import CONVERGED, ENABLED, HAS_TARGET, NAN3
from contid.control.tick.config import RobotConfig
from contid.control.tick.robot_tick import TickResult
from contid.control.tick.state import RobotState
from contid.control.tick.tip_feedback import Measurement
from contid.hal import Sample
from contid.targets import Target

_NAN = math.nan
_NO_SAMPLE = (_NAN, _NAN, 0.0, _NAN, _NAN, _NAN, _NAN, _NAN)
#: A measurement older than this is recorded no more.
FORGOTTEN_S = 1.0
_UNSEEN = (*NAN3, *NAN3, _NAN)
#: Bits that a float64 of the record keeps exactly.
_MAX_NAMES = 52


@dataclass(frozen=True, slots=True)
class CycleSnapshot:
    """What one cycle saw and decided.

    Attributes:
        timing: its place in time, on the clock of the buses.
        now_s: the time of the robots.
        source_s: time in the trajectory, None while none runs.
        targets: by robot, in the world frame.
        outcomes: of every robot's tick.
        states: of every robot, after the exchange.
        samples: newest by axis.
        measured: newest measured tip by robot.
    """

    timing: Timing
    now_s: float
    source_s: float | None
    targets: Mapping[str, Target | None]
    outcomes: Sequence[TickResult]
    states: Sequence[RobotState]
    samples: Mapping[str, Sample]
    measured: Mapping[str, Measurement]


class RecordPacker:
    """Packs cycles for a sink; knows which bit stands for which name in ``limited_by``."""

    def __init__(self, configs: Sequence[RobotConfig], sink: Sink, now: Callable[[], float]) -> None:
        """``now``: the clock of the buses."""
        self._plans = configs
        self._sink = sink
        self._now = now
        self._bits: list[dict[str, int]] = [{} for _ in configs]

    def record(self, turn: CycleSnapshot) -> None:
        """One record of a cycle."""
        timing, source_s = turn.timing, turn.source_s
        values: list[float] = [
            timing.tick, timing.skipped, timing.deadline_s, timing.lateness_s, 0.0,
            _NAN if source_s is None else source_s,
        ]  # fmt: skip
        for index, config in enumerate(self._plans):
            outcome, state = turn.outcomes[index], turn.states[index]
            target, seen = turn.targets.get(config.name), turn.measured.get(config.name)
            self._robot(values, index, outcome, state, target)
            values += _UNSEEN if seen is None else _seen(seen, turn.now_s)
            _axes(values, config, outcome, state, target, turn.samples)
        values[4] = self._now() - timing.deadline_s - timing.lateness_s
        self._sink.write(values)

    def _robot(
        self, values: list[float], index: int, outcome: TickResult, state: RobotState, target: Target | None
    ) -> None:
        solution = outcome.solution
        flags = ENABLED if state.enabled else 0
        bits = iterations = 0
        residual_m = _NAN
        if solution is not None:
            flags |= CONVERGED if solution.converged else 0
            iterations, residual_m = solution.iterations, solution.residual_m
            for name in solution.limited_by:
                bits |= self._bit(index, name)
        tip = direction = mid = load = NAN3
        if target is not None:
            flags |= HAS_TARGET
            tip, direction, mid = target.tip_m or NAN3, target.direction or NAN3, target.mid_m or NAN3
            load = target.load_n
        values += (state.mode, state.fault, flags, bits, iterations)
        values += tip
        values += direction
        values += mid
        values += load
        values += (residual_m, outcome.tip_error_m)

    def _bit(self, index: int, name: str) -> int:
        """The bit of a limit's name; a new one is announced in an event."""
        bits = self._bits[index]
        if name not in bits:
            number = min(len(bits), _MAX_NAMES)
            bits[name] = 1 << number
            self._sink.event("limit_name", robot=self._plans[index].name, bit=number, name=name)
        return bits[name]


def _axes(
    values: list[float],
    config: RobotConfig,
    outcome: TickResult,
    state: RobotState,
    target: Target | None,
    samples: Mapping[str, Sample],
) -> None:
    wanted: Sequence[float] = () if target is None else _wanted(config, target)
    solved: Sequence[float] = () if outcome.solution is None else outcome.solution.actuation
    command, device, limits = state.command, outcome.device, outcome.limits
    for axis, name in enumerate(config.axes):
        values += (
            wanted[axis] if axis < len(wanted) else _NAN,
            solved[axis] if solved else _NAN,
            command[axis] if command else _NAN,
            limits[axis] if limits else 0,
            device[axis] if device else _NAN,
        )
        sample = samples.get(name)
        if sample is None:
            values += _NO_SAMPLE
            continue
        value, velocity, effort = sample.value, sample.velocity, sample.effort
        temperature, voltage = sample.temperature_c, sample.voltage_v
        values += (
            _NAN if value is None else value, sample.time_s, sample.valid, sample.age_s,
            _NAN if velocity is None else velocity, _NAN if effort is None else effort,
            _NAN if temperature is None else temperature, _NAN if voltage is None else voltage,
        )  # fmt: skip


def _seen(seen: Measurement, now_s: float) -> tuple[float, ...]:
    """A tracker's newest pose and its age; nothing of a tracker that is gone."""
    age_s = now_s - seen.time_s
    if age_s > FORGOTTEN_S:
        return _UNSEEN
    return (*seen.tip_in_world, *(seen.direction_in_world or NAN3), age_s)


def _wanted(config: RobotConfig, target: Target) -> Sequence[float]:
    """What a target asks of every axis itself, NaN where the model decides; empty for tips alone."""
    if not target.extra:
        return target.actuation or ()
    own = target.actuation or (_NAN,) * (len(config.axes) - config.extra_axes)
    return (*own, *(target.extra.get(name, _NAN) for name in config.axis_names[len(own) :]))
