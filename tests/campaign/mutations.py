"""Deliberate bugs: each disables one protection, so that the campaign can be seen to notice.

Every entry names the invariant that must be violated. The bugs exist only while a test patches them in.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import pytest

from contid.control.engine.cycle import Timing
from contid.control.engine.engine import Engine
from contid.control.tick import next_command, transitions
from contid.control.tick import robot_tick as loop
from contid.control.tick.arming import next_arming
from contid.control.tick.config import RobotConfig
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.control.tick.transitions import estop, stay
from contid.hal import Sample
from contid.targets import Actuation
from contid_drivers.sim.devices import SimDevice


@dataclass(frozen=True)
class Mutation:
    """One bug.

    Attributes:
        breaks: name of the invariant that finds it.
        seed: of a campaign that meets it soon.
        apply: puts it in place.
        machine: that meets it.
    """

    breaks: str
    seed: int
    apply: Callable[[pytest.MonkeyPatch], None]
    machine: str = "hand"


class OtherLimit:
    """The compiled checks of a robot, one of them replaced."""

    def __init__(self, guard: Any, limit: Callable[[Sequence[float]], Sequence[float]]) -> None:
        self._guard, self._limit = guard, limit

    def limit(
        self, _last: Any, _last_steps: Any, targets: Sequence[float], _target_steps: Any
    ) -> tuple[tuple[float, ...], tuple[int, ...]]:
        return tuple(self._limit(targets)), (0,) * len(targets)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._guard, name)


def _replace_limit(
    patch: pytest.MonkeyPatch, limit: Callable[[RobotConfig, Sequence[float]], Sequence[float]]
) -> None:
    made = RobotConfig.__post_init__

    def make(config: RobotConfig) -> None:
        made(config)
        object.__setattr__(config, "guard", OtherLimit(config.guard, partial(limit, config)))

    patch.setattr(RobotConfig, "__post_init__", make)


def _no_limiter(patch: pytest.MonkeyPatch) -> None:
    """Targets go to the devices as they are."""
    _replace_limit(patch, lambda _, targets: targets)


def _coarse(patch: pytest.MonkeyPatch) -> None:
    """Targets on a grid of a millimetre, where the limiter was."""
    _replace_limit(patch, lambda _, targets: [round(target, 3) for target in targets])


def _gain(patch: pytest.MonkeyPatch) -> None:
    """A gain between model and devices, where the limiter was: the model alone keeps no command inside."""

    def amplified(config: RobotConfig, targets: Sequence[float]) -> Sequence[float]:
        return [1.3 * min(target, axis.upper) for axis, target in zip(config.limits, targets, strict=True)]

    _replace_limit(patch, amplified)


def _one_by_one(patch: pytest.MonkeyPatch) -> None:
    """Each tendon goes to its answer by itself."""

    def alone(*arguments: Any) -> Any:
        return arguments[-1]

    patch.setattr(next_command, "limit_taut", alone)


def _no_tolerance(patch: pytest.MonkeyPatch) -> None:
    """Samples are not looked at any more."""

    def blind(_plan: RobotConfig, state: RobotState, _samples: Sequence[Sample], _now_s: float) -> RobotState:
        return state

    patch.setattr(loop, "watched", blind)


def _no_watchdog(patch: pytest.MonkeyPatch) -> None:
    """Devices go on without a host."""

    def deaf(device: SimDevice, after_s: float) -> None:
        device.fed_at_s += after_s

    patch.setattr(SimDevice, "trip", deaf)


def _old_goal(patch: pytest.MonkeyPatch) -> None:
    """Arming goes on from the last command instead of from where the robot is."""
    before: dict[str, Actuation] = {}

    def rearmed(config: RobotConfig, state: RobotState, *rest: Any) -> RobotState:
        if state.command:
            before[config.name] = state.command
        after = next_arming(config, state, *rest)
        if state.mode is Mode.ARMING and after.mode is not Mode.ARMING and config.name in before:
            return replace(after, command=before[config.name], reference=before[config.name], motion=None)
        return after

    patch.setattr(loop, "next_arming", rearmed)


def _powered_stop(patch: pytest.MonkeyPatch) -> None:
    """An emergency stop that skips the devices."""

    def forgetful(*arguments: Any) -> RobotState:
        return replace(estop(*arguments), pending=())

    patch.setattr(transitions, "estop", forgetful)


def _shared_fate(patch: pytest.MonkeyPatch) -> None:
    """A fault of one robot makes the others hold."""
    cycle = Engine.cycle

    def cycling(engine: Engine, timing: Timing) -> None:
        cycle(engine, timing)
        if any(state.mode is Mode.FAULT for state in engine.robots.states):
            states = engine.robots.states
            for index, (config, state) in enumerate(zip(engine.robots.configs, states, strict=True)):
                if state.mode in (Mode.APPROACH, Mode.RUN):
                    states[index] = stay(config, state, timing.tick * config.period_s)

    patch.setattr(Engine, "cycle", cycling)


MUTATIONS: dict[str, Mutation] = {
    "limiter replaced by a gain": Mutation("position limits", 1, _gain),
    # What is planned keeps the rates by itself, and not the ends of the travel to the last bit.
    "limiter removed": Mutation("position limits", 2, _no_limiter),
    "limiter replaced by a grid": Mutation("velocity and acceleration limits", 2, _coarse),
    "tendons one by one": Mutation("tensions of tendons", 6, _one_by_one, "tendon3"),
    "tolerance ignored": Mutation("fault within the stated ticks", 2, _no_tolerance),
    "watchdog disabled": Mutation("no power without a host", 6, _no_watchdog),
    "re-arm without goal := present": Mutation("no jump on arming", 2, _old_goal),
    "estop skips the devices": Mutation("estop within the tick", 1, _powered_stop),
    "a fault slows everybody": Mutation("other robots unaffected", 1, _shared_fate),
}
