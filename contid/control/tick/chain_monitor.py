"""Looks ahead for the arms of closed chains: no way begins that the rope between them forbids.

Rows of a trajectory are checked before a run (`contid.control.tick.preflight`); ways are planned only when
they
begin, from where the arms are then: the approach to a first row, orders to a point, stops by way of the rest
pose. The arms of a chain therefore begin an approach together, and every way is looked along, every `LOOK_S`,
together with what the other arms are doing:

* an approach that the chain forbids is fault 301 before anything has moved;
* an order to a point is refused, for all arms that were ordered at once;
* a stop by way of the rest pose stops where it is instead.

A chain is one body: an arm in FAULT is fault 302 for the others, and an order that stops one arm, or sends it
to a point of its own, holds those that move. Arms that are outside already (vented arms may lay the rope on
the ground) may move where it gets no worse.

Everything here is a function of plans, states and samples, so a replay decides the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

from contid.control.tick import state as change
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault
from contid.control.tick.preflight import LOOK_S
from contid.control.tick.robot_tick import tick
from contid.control.tick.state import AxisMotion, OrderRefusedError, RobotState
from contid.control.tick.supervisor import MOVING, Event, Mode
from contid.control.tick.tip_feedback import Measurement
from contid.hal import Sample
from contid.kinematics.rope.chain import ChainGuard, Tip
from contid.robot_file.base import StopPolicy
from contid.targets import Actuation, Target

#: A rope may dip by so much below where it was, while its arms are outside already [m].
LEEWAY_M: Final = 1e-3

#: Samples of a robot in the order of its axes, empty when there are none.
Samples: TypeAlias = Callable[[RobotConfig], tuple[Sample, ...]]

_BEFORE: Final = frozenset({Mode.OFF, Mode.CONNECTING, Mode.READY, Mode.ARMING})
_AWAY: Final = frozenset({Mode.OFF, Mode.FAULT, Mode.STOPPING})


@dataclass(frozen=True, slots=True)
class PlannedPath:
    """What one arm does from now on: a motion that began before or now, or nothing."""

    actuation: Actuation
    motion: AxisMotion | None = None
    since_s: float = 0.0

    @property
    def duration_s(self) -> float:
        """How long it goes on."""
        return 0.0 if self.motion is None else max(0.0, self.motion.duration_s - self.since_s)

    def at(self, t_s: float) -> Actuation:
        """Where the arm is a time from now."""
        return self.actuation if self.motion is None else self.motion.at(self.since_s + t_s)[0]


@dataclass(frozen=True, slots=True)
class Chained:
    """A guard and where its arms stand among the robots."""

    guard: ChainGuard
    arms: tuple[int, ...]


class ChainWatch:
    """The chains of a file; ``states`` are the engine's, and are changed in place."""

    def __init__(self, guards: Sequence[ChainGuard], configs: Sequence[RobotConfig]) -> None:
        self._plans = tuple(configs)
        self._index = {config.name: index for index, config in enumerate(configs)}
        self._chains = [Chained(guard, tuple(self._index[arm] for arm in guard.arms)) for guard in guards]

    def concerns(self, robot: str) -> bool:
        """True for the arms of chains."""
        return any(self._index.get(robot) in chain.arms for chain in self._chains)

    # -- before a tick ----------------------------------------------------------------------------------

    def targets(
        self, targets: Mapping[str, Target | None], states: Sequence[RobotState]
    ) -> Mapping[str, Target | None]:
        """Targets of the source; None for an arm that waits for the others of its chain."""
        waiting: dict[str, None] = {}
        for chain in self._chains:
            following = [i for i in chain.arms if targets.get(self._plans[i].name) is not None]
            ready = all(_ready(states[i]) for i in following)
            for i in following:
                if not ready and states[i].mode in (Mode.ARMING, Mode.HOLD):
                    waiting[self._plans[i].name] = None
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
                state, config = states[i], self._plans[i]
                target = targets.get(config.name)
                waits = state.mode in (Mode.ARMING, Mode.HOLD) and state.follow and state.goto is None
                if waits and target is not None:
                    after = tick(
                        config, state, now_s, samples(config), target, measured.get(config.name)
                    ).state
                    if after.mode is Mode.APPROACH:
                        begun[i] = after
            message = self._forbids(chain, states, begun, now_s, samples) if begun else ""
            for i, after in begun.items() if message else ():
                states[i] = _forbidden(self._plans[i], states[i], after, message, now_s)

    # -- orders -----------------------------------------------------------------------------------------

    def gotos(
        self, states: list[RobotState], targets: Mapping[str, Target], now_s: float, samples: Samples
    ) -> Iterator[tuple[str, str]]:
        """Begin orders to points; yields (robot, words) for refused ones, of a chain all or none."""
        for chain in self._chains:
            ordered = {i: targets[self._plans[i].name] for i in chain.arms if self._plans[i].name in targets}
            if not ordered:
                continue
            trial = list(states)
            begun: dict[int, RobotState] = {}
            try:
                for i, target in ordered.items():
                    trial[i] = change.goto(self._plans[i], states[i], target, now_s)
                self._hold_others(chain, trial, frozenset(ordered), now_s)
                for i in ordered:
                    begun[i] = tick(self._plans[i], trial[i], now_s, samples(self._plans[i]), None).state
                message = self._forbids(chain, trial, begun, now_s, samples)
            except OrderRefusedError as error:
                message = str(error)
            if message:
                yield from ((self._plans[i].name, message) for i in ordered)
            else:
                states[:] = trial

    def stopped(
        self, states: list[RobotState], named: Sequence[str] | None, now_s: float, samples: Samples
    ) -> Iterator[tuple[str, str]]:
        """After orders that stop ``named`` robots (None: all): the others of their chains hold.

        Yields (robot, words) for arms that do not go to their rest pose, because the chain forbids the way.
        """
        for chain in self._chains:
            if named is not None:
                stopped = frozenset(i for i in chain.arms if self._plans[i].name in named)
                if stopped:
                    self._hold_others(chain, states, stopped, now_s)
            resting = [i for i in chain.arms if _resting(states[i])]
            message = self._forbids(chain, states, {}, now_s, samples) if resting else ""
            for i in resting if message else ():
                states[i] = change.stop(self._plans[i], states[i], StopPolicy.HOLD, now_s)
                yield self._plans[i].name, f"{message}; it stops where it is instead of at its rest pose"

    def _hold_others(
        self, chain: Chained, states: list[RobotState], apart: frozenset[int], now_s: float
    ) -> None:
        for i in chain.arms:
            if i not in apart and states[i].mode in (Mode.RUN, Mode.APPROACH):
                states[i] = change.hold(self._plans[i], states[i], now_s)

    # -- after a tick -----------------------------------------------------------------------------------

    def faults(self, states: list[RobotState], before: Sequence[Mode], now_s: float) -> None:
        """An arm that went to FAULT takes the others of its chain along."""
        for chain in self._chains:
            for i in chain.arms:
                state = states[i]
                new = state.mode is Mode.FAULT and before[i] is not Mode.FAULT
                if not new or state.fault is Fault.CHAIN_BROKEN:
                    continue
                for other in chain.arms:
                    if states[other].enabled or states[other].wanted:
                        message = (
                            f"{chain.guard.name}: {self._plans[i].name} has fault {int(state.fault)} "
                            f"{state.fault.name.lower().replace('_', '-')}"
                        )
                        config = self._plans[other]
                        states[other] = change.fail(config, states[other], Fault.CHAIN_BROKEN, message, now_s)

    # -- inside -----------------------------------------------------------------------------------------

    def _forbids(
        self,
        chain: Chained,
        states: Sequence[RobotState],
        begun: Mapping[int, RobotState],
        now_s: float,
        samples: Samples,
    ) -> str:
        """Why the arms may not go on as they are and ``begun`` says; "" when they may."""
        ways: dict[int, PlannedPath] = {}
        for i in chain.arms:
            way = self._way(i, begun.get(i, states[i]), now_s, samples)
            if way is None:
                return f"{chain.guard.name}: where {self._plans[i].name} is, is not known"
            ways[i] = way
        duration_s = max(way.duration_s for way in ways.values())
        looks = max(1, math.ceil(duration_s / LOOK_S))
        best = -math.inf
        for k in range(looks + 1):
            t_s = duration_s * k / looks
            state = chain.guard.check(
                {self._plans[i].name: self._tip(i, way.at(t_s)) for i, way in ways.items()}
            )
            if k and not state.margin_m >= (0.0 if best >= 0.0 else best - LEEWAY_M):
                return f"{chain.guard.name}: on the way, {state.reason}"
            best = max(best, state.margin_m)
        return ""

    def _way(self, index: int, state: RobotState, now_s: float, samples: Samples) -> PlannedPath | None:
        """What an arm does from now on; None when nobody knows where it is."""
        config = self._plans[index]
        if state.command and (state.enabled or state.mode in MOVING):
            return PlannedPath(state.command, state.motion, now_s - state.motion_s)
        values = [sample.value for sample in samples(config) if sample.valid and sample.value is not None]
        if len(values) < len(config.axes):
            return PlannedPath(state.command) if state.command else None
        return PlannedPath(config.transmission.to_actuation(tuple(values)))

    def _tip(self, index: int, actuation: Actuation) -> Tip:
        config = self._plans[index]
        pose = config.model.forward(actuation)
        return config.frame.point_in_world(pose.tip_m), config.frame.vector_in_world(pose.direction)


def _ready(state: RobotState) -> bool:
    """True for an arm that follows the source, or will from this tick on."""
    if not state.follow or state.mode in _AWAY:
        return False
    return state.mode not in _BEFORE or (state.mode is Mode.ARMING and state.enabled)


def _resting(state: RobotState) -> bool:
    return state.mode is Mode.STOPPING and state.policy is StopPolicy.REST


def _forbidden(
    config: RobotConfig, before: RobotState, after: RobotState, message: str, now_s: float
) -> RobotState:
    """FAULT in place of an approach: the arm stays as it was, whatever its policy for faults."""
    still = before
    if not before.command:  # armed in this very tick: where it is stands in what would have followed
        rest = (0.0,) * len(after.command)
        still = replace(before, command=after.command, aim=after.command, steps=rest, motion=None)
    latched = change.moved(config, still, Event.FAULT, now_s)
    return replace(
        latched,
        fault=Fault.CHAIN_FORBIDS,
        message=message,
        wanted=False,
        follow=False,
        goto=None,
        policy=None,
    )
