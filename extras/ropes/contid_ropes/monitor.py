"""Checks the paths of the arms of closed chains before they begin, and keeps the arms together.

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
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from contid.control.engine.cycle import Sink, Timing
from contid.control.engine.events.robots import OrderRefused
from contid.control.engine.exchange import Exchange
from contid.control.engine.messages import RobotNames
from contid.control.engine.robots import Robots, Stopping
from contid.control.engine.stages import ArmsTogether, Targets
from contid.control.tick import transitions
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault
from contid.control.tick.preflight.rows import SAMPLE_INTERVAL_S
from contid.control.tick.robot_tick import tick
from contid.control.tick.state import AxisMotion, OrderRefusedError, RobotState
from contid.control.tick.supervisor import MOVING, UNARMED, Mode
from contid.control.tick.tip_feedback import Measurement
from contid.robot_file.base import StopPolicy
from contid.targets import Actuation, Target, Tip
from contid_ropes.chain import ChainGuard

#: A negative margin may shrink by this along a path [m].
TOLERANCE_M: Final = 1e-3

#: Modes of a robot that does not follow.
_NOT_FOLLOWING: Final = frozenset({Mode.OFF, Mode.FAULT, Mode.STOPPING})


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


class ChainMonitor(ArmsTogether):
    """The closed chains of a file."""

    def __init__(self, guards: Sequence[ChainGuard], robots: Robots, exchange: Exchange, sink: Sink) -> None:
        index = {config.name: number for number, config in enumerate(robots.configs)}
        self.chains = tuple(Chained(guard, tuple(index[arm] for arm in guard.arms)) for guard in guards)
        self.robots: Sequence[int] = sorted({arm for chain in self.chains for arm in chain.arms})
        self._robots = robots
        self._exchange = exchange
        self._sink = sink
        self._gotos: dict[str, Target] = {}

    @property
    def has_chains(self) -> bool:
        """See `ArmsTogether`."""
        return True

    def concerns(self, robot: str) -> bool:
        """True for the arms of chains."""
        return any(robot in chain.guard.arms for chain in self.chains)

    # -- before a tick ----------------------------------------------------------------------------------

    def before(self, targets: Targets, timing: Timing, now_s: float) -> Targets:
        """Begin ordered moves; the targets, with None for an arm that waits for the others of its chain.

        Arms that would begin a forbidden approach to their target in this tick get fault 301.
        """
        self.begin_gotos(now_s)
        targets = dict(targets)
        configs, states = self._robots.configs, self._robots.states
        for chain in self.chains:
            following = [i for i in chain.arms if targets.get(configs[i].name) is not None]
            ready = all(_ready(states[i]) for i in following)
            for i in following:
                if not ready and states[i].mode in (Mode.ARMING, Mode.HOLD):
                    targets[configs[i].name] = None
        for chain in self.chains:
            begun: dict[int, RobotState] = {}
            for i in chain.arms:
                name = configs[i].name
                if _begins(states[i], targets.get(name)):
                    after = self._after_tick_of(
                        i, states[i], now_s, targets.get(name), self._robots.measured.get(name)
                    )
                    if after.mode is Mode.APPROACH:
                        begun[i] = after
            message = self._forbids(chain, states, begun, now_s) if begun else ""
            for i, after in begun.items() if message else ():
                states[i] = _forbidden(configs[i], states[i], after, message, now_s)
        return targets

    # -- orders -----------------------------------------------------------------------------------------

    def keep_goto(self, robot: str, target: Target) -> None:
        """Keep a goto of an arm until `begin_gotos` checks all of one tick together."""
        self._gotos[robot] = target

    def begin_gotos(self, now_s: float) -> None:
        """Begin the gotos of one tick, of a chain all or none; refuse forbidden ones."""
        if not self._gotos:
            return
        targets, self._gotos = self._gotos, {}
        configs, states = self._robots.configs, self._robots.states
        for chain in self.chains:
            ordered = {i: targets[configs[i].name] for i in chain.arms if configs[i].name in targets}
            if not ordered:
                continue
            trial = list(states)
            try:
                for i, target in ordered.items():
                    trial[i] = transitions.goto(configs[i], states[i], target, now_s)
                for i in _followers(chain, trial, ordered):
                    trial[i] = transitions.hold(configs[i], trial[i], now_s)
                begun = {i: self._after_tick_of(i, trial[i], now_s) for i in ordered}
                message = self._forbids(chain, trial, begun, now_s)
            except OrderRefusedError as error:
                message = str(error)
            except Exception as error:  # an order to stop may come behind the gotos
                message = _defect(chain, error)
            if not message:
                states[:] = trial
            for i in ordered if message else ():
                self._refuse(i, message)

    def stopped(self, who: RobotNames, now_s: float) -> None:
        """After an order that stops robots: their chains hold, and forbidden ways to rest poses end."""
        configs, states = self._robots.configs, self._robots.states
        for chain in self.chains:
            if who is not None:
                stopped = [i for i in chain.arms if configs[i].name in who]
                for i in _followers(chain, states, stopped) if stopped else ():
                    self._robots.change(i, transitions.hold, now_s)
            resting = [i for i in chain.arms if _resting(states[i])]
            try:
                message = self._forbids(chain, states, {}, now_s) if resting else ""
            except Exception as error:  # the others have to stop all the same
                message = _defect(chain, error)
            for i in resting if message else ():
                self._robots.change(i, Stopping(StopPolicy.HOLD, "on_end"), now_s)
                self._refuse(i, f"{message}; it stops where it is instead of at its rest pose")

    def _refuse(self, index: int, message: str) -> None:
        self._sink.event(OrderRefused(robot=self._robots.configs[index].name, message=message))

    # -- after a tick -----------------------------------------------------------------------------------

    def settle(self, now_s: float) -> None:
        """Fault 302 for the other arms of a chain when one arm enters FAULT."""
        robots = self._robots
        for chain in self.chains:
            for i in chain.arms:
                state = robots.states[i]
                new = state.mode is Mode.FAULT and robots.reported[i] is not Mode.FAULT
                if not new or state.fault is Fault.CHAIN_BROKEN:
                    continue
                name = state.fault.name.lower().replace("_", "-")
                message = f"{chain.guard.name}: {robots.configs[i].name} has fault {int(state.fault)} {name}"
                for other in chain.arms:
                    if robots.states[other].enabled or robots.states[other].arm_requested:
                        robots.fail(other, Fault.CHAIN_BROKEN, message, now_s)

    # -- inside -----------------------------------------------------------------------------------------

    def _after_tick_of(
        self,
        index: int,
        state: RobotState,
        now_s: float,
        target: Target | None = None,
        measured: Measurement | None = None,
    ) -> RobotState:
        """The state of an arm after the tick that comes."""
        config = self._robots.configs[index]
        return tick(config, state, now_s, self._exchange.samples_of(config), target, measured).state

    def _forbids(
        self, chain: Chained, states: Sequence[RobotState], begun: Mapping[int, RobotState], now_s: float
    ) -> str:
        """Why the chain forbids the paths of ``states`` and ``begun``; "" when it allows them."""
        paths: dict[int, PlannedPath] = {}
        for i in chain.arms:
            path = self._path(i, begun.get(i, states[i]), now_s)
            if path is None:
                return f"{chain.guard.name}: the position of {self._robots.configs[i].name} is unknown"
            paths[i] = path
        duration_s = max(path.duration_s for path in paths.values())
        steps = max(1, math.ceil(duration_s / SAMPLE_INTERVAL_S))
        best = -math.inf
        for k in range(steps + 1):
            t_s = duration_s * k / steps
            tips = dict(self._tip(i, path.at(t_s)) for i, path in paths.items())
            state = chain.guard.check(tips)
            if k and not state.margin_m >= (0.0 if best >= 0.0 else best - TOLERANCE_M):
                return f"{chain.guard.name}: on the way, {state.reason}"
            best = max(best, state.margin_m)
        return ""

    def _path(self, index: int, state: RobotState, now_s: float) -> PlannedPath | None:
        """The further path of an arm; None when its position is unknown."""
        config = self._robots.configs[index]
        if state.command and (state.enabled or state.mode in MOVING):
            return PlannedPath(state.command, state.motion, now_s - state.motion_s)
        at = config.measured_actuation(self._exchange.samples_of(config)) or state.command
        return PlannedPath(at) if at else None

    def _tip(self, index: int, actuation: Actuation) -> tuple[str, Tip]:
        """Name of an arm, and its tip and direction in the world."""
        config = self._robots.configs[index]
        pose = config.model.forward(actuation)
        tip = config.frame.point_in_world(pose.tip_m), config.frame.vector_in_world(pose.direction)
        return config.name, tip


def _ready(state: RobotState) -> bool:
    """True for an arm that follows the source now or from this tick on."""
    if not state.follow or state.mode in _NOT_FOLLOWING:
        return False
    return state.mode not in UNARMED or (state.mode is Mode.ARMING and state.enabled)


def _begins(state: RobotState, target: Target | None) -> bool:
    """True for an arm that may begin an approach in the next tick, to its target or inside its limits."""
    follows = state.follow and state.goto is None and target is not None
    return state.mode in (Mode.ARMING, Mode.HOLD) and (state.recovering or follows)


def _defect(chain: Chained, error: Exception) -> str:
    return f"{chain.guard.name}: not checked, {type(error).__name__}: {error}"


def _followers(chain: Chained, states: Sequence[RobotState], apart: Collection[int]) -> list[int]:
    """The arms of a chain that move with it, but for some."""
    return [i for i in chain.arms if i not in apart and states[i].mode in (Mode.RUN, Mode.APPROACH)]


def _resting(state: RobotState) -> bool:
    return state.mode is Mode.STOPPING and state.policy is StopPolicy.REST


def _forbidden(
    config: RobotConfig, before: RobotState, after: RobotState, message: str, now_s: float
) -> RobotState:
    """FAULT instead of an approach: the arm holds, whatever its ``on_fault`` policy."""
    if not before.command:  # armed in this tick: the state after it has the position
        rest = (0.0,) * len(after.command)
        at = after.command
        before = replace(before, command=at, reference=at, increments=rest, before=rest, motion=None)
    return transitions.latch_fault(config, before, Fault.CHAIN_FORBIDS, message, now_s)
