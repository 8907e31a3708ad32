"""Checks the paths of the arms of closed chains before they begin.

Rows of a trajectory are checked before a run (`contid.control.tick.preflight`). Other paths are known only
when they begin: the approach to the first row, orders to a point, stops through the rest pose. The arms of a
chain begin an approach together, and every path is sampled every `SAMPLE_INTERVAL_S` together with the motion
of the other arms. If the rope forbids it,

* an approach becomes fault 301 before anything moves;
* an order to a point is refused, for all arms that were ordered at once;
* a stop through the rest pose becomes a stop on the spot.

An arm in FAULT is fault 302 for the others of its chain. An order that stops one arm, or moves it to a point,
holds the others. Arms that violate the chain already (vented arms may lay the rope on the ground) may move as
long as the margin does not shrink.

Everything is a function of configurations, states and samples, so a replay decides the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

from contid.control.tick import transitions
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault
from contid.control.tick.preflight.rows import SAMPLE_INTERVAL_S
from contid.control.tick.robot_tick import tick
from contid.control.tick.state import AxisMotion, OrderRefusedError, RobotState
from contid.control.tick.supervisor import MOVING, Event, Mode
from contid.control.tick.tip_feedback import Measurement
from contid.hal import Sample
from contid.kinematics.rope.chain import ChainGuard, Tip
from contid.robot_file.base import StopPolicy
from contid.targets import Actuation, Target

#: A negative margin may shrink by this along a path [m].
TOLERANCE_M: Final = 1e-3

#: Samples of a robot in the order of its axes, empty when there are none.
Samples: TypeAlias = Callable[[RobotConfig], tuple[Sample, ...]]

_BEFORE: Final = frozenset({Mode.OFF, Mode.CONNECTING, Mode.READY, Mode.ARMING})
_AWAY: Final = frozenset({Mode.OFF, Mode.FAULT, Mode.STOPPING})


@dataclass(frozen=True, slots=True)
class PlannedPath:
    """The further path of one arm: a motion that has begun, or standstill."""

    actuation: Actuation
    motion: AxisMotion | None = None
    since_s: float = 0.0

    @property
    def duration_s(self) -> float:
        """Time to its end [s]."""
        return 0.0 if self.motion is None else max(0.0, self.motion.duration_s - self.since_s)

    def at(self, t_s: float) -> Actuation:
        """Actuation a time from now."""
        return self.actuation if self.motion is None else self.motion.at(self.since_s + t_s)[0]


@dataclass(frozen=True, slots=True)
class Chained:
    """A guard and the indices of its arms among the robots."""

    guard: ChainGuard
    arms: tuple[int, ...]


class ChainMonitor:
    """The chains of a file; ``states`` of the engine are changed in place."""

    def __init__(self, guards: Sequence[ChainGuard], configs: Sequence[RobotConfig]) -> None:
        self._configs = tuple(configs)
        self._index = {config.name: index for index, config in enumerate(configs)}
        self._chains = [Chained(guard, tuple(self._index[arm] for arm in guard.arms)) for guard in guards]

    def concerns(self, robot: str) -> bool:
        """True for the arms of chains."""
        return any(self._index.get(robot) in chain.arms for chain in self._chains)

    # -- before a tick ----------------------------------------------------------------------------------

    def targets(
        self, targets: Mapping[str, Target | None], states: Sequence[RobotState]
    ) -> Mapping[str, Target | None]:
        """The targets, with None for an arm that waits for the others of its chain."""
        waiting: dict[str, None] = {}
        for chain in self._chains:
            following = [i for i in chain.arms if targets.get(self._configs[i].name) is not None]
            ready = all(_ready(states[i]) for i in following)
            for i in following:
                if not ready and states[i].mode in (Mode.ARMING, Mode.HOLD):
                    waiting[self._configs[i].name] = None
        return {**targets, **waiting} if waiting else targets

    def begin(
        self,
        states: list[RobotState],
        targets: Mapping[str, Target | None],
        now_s: float,
        samples: Samples,
        measured: Mapping[str, Measurement],
    ) -> None:
        """Fault 301 for arms that would begin a forbidden approach to the source in this tick."""
        for chain in self._chains:
            begun: dict[int, RobotState] = {}
            for i in chain.arms:
                state, config = states[i], self._configs[i]
                target = targets.get(config.name)
                waits = state.mode in (Mode.ARMING, Mode.HOLD) and state.follow and state.goto is None
                recovers = state.recovering and state.mode in (Mode.ARMING, Mode.HOLD)
                if recovers or (waits and target is not None):
                    after = tick(
                        config, state, now_s, samples(config), target, measured.get(config.name)
                    ).state
                    if after.mode is Mode.APPROACH:
                        begun[i] = after
            message = self._forbids(chain, states, begun, now_s, samples) if begun else ""
            for i, after in begun.items() if message else ():
                states[i] = _forbidden(self._configs[i], states[i], after, message, now_s)

    # -- orders -----------------------------------------------------------------------------------------

    def gotos(
        self, states: list[RobotState], targets: Mapping[str, Target], now_s: float, samples: Samples
    ) -> Iterator[tuple[str, str]]:
        """Begin gotos, of a chain all or none; yields (robot, message) for refused ones."""
        for chain in self._chains:
            ordered = {
                i: targets[self._configs[i].name] for i in chain.arms if self._configs[i].name in targets
            }
            if not ordered:
                continue
            trial = list(states)
            begun: dict[int, RobotState] = {}
            try:
                for i, target in ordered.items():
                    trial[i] = transitions.goto(self._configs[i], states[i], target, now_s)
                self._hold_others(chain, trial, frozenset(ordered), now_s)
                for i in ordered:
                    begun[i] = tick(self._configs[i], trial[i], now_s, samples(self._configs[i]), None).state
                message = self._forbids(chain, trial, begun, now_s, samples)
            except OrderRefusedError as error:
                message = str(error)
            if message:
                yield from ((self._configs[i].name, message) for i in ordered)
            else:
                states[:] = trial

    def stopped(
        self, states: list[RobotState], named: Sequence[str] | None, now_s: float, samples: Samples
    ) -> Iterator[tuple[str, str]]:
        """After orders that stop ``named`` robots (None: all): the others of their chains hold.

        Yields (robot, message) for arms that stop because the chain forbids the path to the rest pose.
        """
        for chain in self._chains:
            if named is not None:
                stopped = frozenset(i for i in chain.arms if self._configs[i].name in named)
                if stopped:
                    self._hold_others(chain, states, stopped, now_s)
            resting = [i for i in chain.arms if _resting(states[i])]
            message = self._forbids(chain, states, {}, now_s, samples) if resting else ""
            for i in resting if message else ():
                states[i] = transitions.stop(self._configs[i], states[i], StopPolicy.HOLD, now_s)
                yield self._configs[i].name, f"{message}; it stops where it is instead of at its rest pose"

    def _hold_others(
        self, chain: Chained, states: list[RobotState], apart: frozenset[int], now_s: float
    ) -> None:
        for i in chain.arms:
            if i not in apart and states[i].mode in (Mode.RUN, Mode.APPROACH):
                states[i] = transitions.hold(self._configs[i], states[i], now_s)

    # -- after a tick -----------------------------------------------------------------------------------

    def faults(self, states: list[RobotState], before: Sequence[Mode], now_s: float) -> None:
        """Latch fault 302 in the other arms when one arm enters FAULT."""
        for chain in self._chains:
            for i in chain.arms:
                state = states[i]
                new = state.mode is Mode.FAULT and before[i] is not Mode.FAULT
                if not new or state.fault is Fault.CHAIN_BROKEN:
                    continue
                for other in chain.arms:
                    if states[other].enabled or states[other].arm_requested:
                        message = (
                            f"{chain.guard.name}: {self._configs[i].name} has fault {int(state.fault)} "
                            f"{state.fault.name.lower().replace('_', '-')}"
                        )
                        config = self._configs[other]
                        states[other] = transitions.fail(
                            config, states[other], Fault.CHAIN_BROKEN, message, now_s
                        )

    # -- inside -----------------------------------------------------------------------------------------

    def _forbids(
        self,
        chain: Chained,
        states: Sequence[RobotState],
        begun: Mapping[int, RobotState],
        now_s: float,
        samples: Samples,
    ) -> str:
        """Why the chain forbids the paths of ``states`` and ``begun``; "" when it allows them."""
        paths: dict[int, PlannedPath] = {}
        for i in chain.arms:
            path = self._path(i, begun.get(i, states[i]), now_s, samples)
            if path is None:
                return f"{chain.guard.name}: the position of {self._configs[i].name} is unknown"
            paths[i] = path
        duration_s = max(path.duration_s for path in paths.values())
        steps = max(1, math.ceil(duration_s / SAMPLE_INTERVAL_S))
        best = -math.inf
        for k in range(steps + 1):
            t_s = duration_s * k / steps
            state = chain.guard.check(
                {self._configs[i].name: self._tip(i, path.at(t_s)) for i, path in paths.items()}
            )
            if k and not state.margin_m >= (0.0 if best >= 0.0 else best - TOLERANCE_M):
                return f"{chain.guard.name}: on the way, {state.reason}"
            best = max(best, state.margin_m)
        return ""

    def _path(self, index: int, state: RobotState, now_s: float, samples: Samples) -> PlannedPath | None:
        """The further path of an arm; None when its position is unknown."""
        config = self._configs[index]
        if state.command and (state.enabled or state.mode in MOVING):
            return PlannedPath(state.command, state.motion, now_s - state.motion_s)
        values = [sample.value for sample in samples(config) if sample.valid and sample.value is not None]
        if len(values) < len(config.axes):
            return PlannedPath(state.command) if state.command else None
        return PlannedPath(config.transmission.to_actuation(tuple(values)))

    def _tip(self, index: int, actuation: Actuation) -> Tip:
        config = self._configs[index]
        pose = config.model.forward(actuation)
        return config.frame.point_in_world(pose.tip_m), config.frame.vector_in_world(pose.direction)


def _ready(state: RobotState) -> bool:
    """True for an arm that follows the source now or from this tick on."""
    if not state.follow or state.mode in _AWAY:
        return False
    return state.mode not in _BEFORE or (state.mode is Mode.ARMING and state.enabled)


def _resting(state: RobotState) -> bool:
    return state.mode is Mode.STOPPING and state.policy is StopPolicy.REST


def _forbidden(
    config: RobotConfig, before: RobotState, after: RobotState, message: str, now_s: float
) -> RobotState:
    """FAULT instead of an approach: the arm holds, whatever its ``on_fault`` policy."""
    still = before
    if not before.command:  # armed in this tick: the state after it has the position
        rest = (0.0,) * len(after.command)
        still = replace(before, command=after.command, reference=after.command, increments=rest, motion=None)
    latched = transitions.moved(config, still, Event.FAULT, now_s)
    return replace(
        latched,
        fault=Fault.CHAIN_FORBIDS,
        message=message,
        arm_requested=False,
        follow=False,
        goto=None,
        policy=None,
    )
