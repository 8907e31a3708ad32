"""Keeps bodies apart in every tick, whatever moves them: targets, feedback, stops through the rest pose.

A tick is allowed when every pair keeps the margin at its commands, and keeps it too if all robots stop from
there. Otherwise the robots of the pair stop in this tick, from the commands of the one before, for which that
was certain. So a robot in motion always has room to stop. That stop decelerates at the limit of its axes
(`contid.trajectory.straight_stop`).

A robot that follows a stream or goes to a point holds then, with a refusal; one on its way to the rest pose
stops where it is; one that follows a trajectory, which was checked before, has fault 303.

A model that fails where its body is asked for is a fault of its robot. The others stop too, where it was
certain that all can, and hold: no distance from that body is known before its model answers again.

A robot without power is where its samples are. Everything is a function of configurations, states and
samples, so a replay decides the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from contid.control.engine.cycle import Timing
from contid.control.engine.events.robots import OrderRefused
from contid.control.engine.stages import EngineParts, Targets, TickStage
from contid.control.tick import transitions
from contid.control.tick.axis_motions import braking_at_once, straight_stop
from contid.control.tick.robot_tick import TickResult, tick_again
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import ARMED, Mode
from contid.robot_file.base import StopPolicy
from contid.targets import ZERO3, Actuation, Target, Vec3
from contid.trajectory.straight_stop import StraightStop
from contid_clearance.arm import ArmParts
from contid_clearance.guard import ClearanceGuard
from contid_clearance.walk import RESOLUTION_M, Walk


class BodyUnknownError(Exception):
    """The body of a robot cannot be computed; its argument is the name of the robot."""


class ClearanceWatch(TickStage):
    """The bodies of a file as the tick commands them.

    Args:
        guard: what is kept apart.
        parts: of the engine.
    """

    def __init__(self, guard: ClearanceGuard, parts: EngineParts) -> None:
        self._guard = guard
        guard.parts_of = self._parts_of
        self._robots = robots = parts.robots
        if robots.configs[0].motion_rules < 10:
            guard.ask_as_before()
        self._exchange = parts.exchange
        self._follows_trajectory = parts.follows_trajectory
        self._sink = parts.sink
        self.robots = [i for i, config in enumerate(robots.configs) if config.name in guard.arms]
        self._walk: Walk | None = None
        self._loads: dict[str, Vec3] = dict.fromkeys(guard.arms, ZERO3)
        self._driven: dict[str, bool] = {}
        #: Targets of a stream that were refused; a robot holds until it gets another one.
        self._refused: dict[int, Target] = {}
        self._unknown = False
        self._now_s = 0.0

    def before(self, targets: Targets, timing: Timing, now_s: float) -> Targets:
        """See `TickStage.before`: None instead of a target that was refused before."""
        if not self._refused:
            return targets
        kept = dict(targets)
        for index, refused in list(self._refused.items()):
            name = self._robots.configs[index].name
            if kept.get(name) == refused:
                kept[name] = None
            else:
                del self._refused[index]
        return kept

    def after(self, outcomes: list[TickResult], targets: Targets, now_s: float) -> None:
        """See `TickStage.after`: robots that come too near get results that stop them."""
        self._now_s = now_s
        if self._unknown and not any(any(outcomes[i].state.increments) for i in self.robots):
            return
        try:
            self._keep_apart(outcomes, targets, now_s)
            self._unknown = False
        except BodyUnknownError as error:
            self._hold_all(str(error), outcomes, now_s)
            self._walk, self._unknown = None, True
            self._driven.clear()

    def _keep_apart(self, outcomes: list[TickResult], targets: Targets, now_s: float) -> None:
        timed = self._follows_trajectory()
        for name in self._guard.arms:
            target = targets.get(name)
            if target is not None:
                self._loads[name] = target.load_n
        walk = self._placed(outcomes)
        held: set[int] = set()
        while True:
            ahead = walk.copy()
            message = ahead.to(self._commanded(outcomes)) or ahead.stops(self._stops(outcomes), RESOLUTION_M)
            if not message:
                self._walk = ahead
                return
            pair = [i for i in self.robots if self._robots.configs[i].name in ahead.refused]
            moving = [i for i in pair if i not in held and any(outcomes[i].state.increments)]
            for i in moving:
                config = self._robots.configs[i]
                stopped = self._stopped(i, message, targets.get(config.name), now_s, timed)
                outcomes[i] = self._again(i, stopped, now_s)
            held.update(moving)
            if not moving:  # every robot of the pair stops already
                walk.place({**walk.configuration, **self._commanded(outcomes)})
                self._walk = walk
                return

    def _parts_of(self, name: str, actuation: Actuation, load_n: Vec3) -> ArmParts:
        """See `ClearanceGuard.parts_of`."""
        arm = self._guard.arms[name]
        parts = self._robots.ask_for_stage(name, self._now_s, arm.parts, actuation, load_n)
        if parts is None:
            raise BodyUnknownError(name)
        return parts

    def _hold_all(self, unknown: str, outcomes: list[TickResult], now_s: float) -> None:
        """The robot whose body is unknown has a fault by now; the others that move stop and hold."""
        for i in self.robots:
            config, state = self._robots.configs[i], self._robots.states[i]
            if config.name != unknown:
                if not any(outcomes[i].state.increments):
                    continue
                message = f"the body of {unknown} cannot be computed"
                if state.mode in ARMED and (state.follow or state.goto or state.recovering or state.squeeze):
                    self._refuse(config.name, f"{message}; it holds")
                    state = transitions.hold(config, state, now_s)
                elif state.mode is Mode.STOPPING and state.policy is StopPolicy.REST:
                    self._refuse(config.name, f"{message}; it stops where it is instead of at its rest pose")
                    state = transitions.stop(config, state, StopPolicy.HOLD, now_s)
                state = braking_at_once(config, state, now_s)
            outcomes[i] = self._again(i, state, now_s)

    def _again(self, index: int, state: RobotState, now_s: float) -> TickResult:
        """The result of a tick that begins with a state in which the robot stops."""
        config = self._robots.configs[index]
        return tick_again(config, state, now_s, self._exchange.samples_of(config))

    def _placed(self, outcomes: Sequence[TickResult]) -> Walk:
        """The walk at the commands of the tick before; where power came or went, and without it, set anew.

        A robot without power is at its samples, before the first at its rest pose.
        """
        walk = self._walk
        now = {} if walk is None else dict(walk.configuration)
        jumped = walk is None
        for i in self.robots:
            config, state = self._robots.configs[i], outcomes[i].state
            name, driven = config.name, _driven(state)
            if driven and self._driven.get(name, False):
                continue
            self._driven[name] = driven
            at: Actuation | None = state.command
            if not driven:
                at = config.measured_actuation(self._exchange.samples_of(config))
            if name not in now:
                now[name] = (at or config.rest, ZERO3)
            elif at and self._guard.arms[name].motion_m(now[name][0], at) > RESOLUTION_M:
                now[name], jumped = (at, now[name][1]), True
        if walk is None:
            return Walk(self._guard, now)
        if jumped:
            walk.place(now)
        return walk

    def _commanded(self, outcomes: Sequence[TickResult]) -> dict[str, tuple[Actuation, Vec3]]:
        """The configuration at the commands of the robots under power."""
        names = {i: self._robots.configs[i].name for i in self.robots if _driven(outcomes[i].state)}
        return {name: (outcomes[i].state.command, self._loads[name]) for i, name in names.items()}

    def _stops(self, outcomes: Sequence[TickResult]) -> dict[str, StraightStop]:
        states = [(self._robots.configs[i], outcomes[i].state) for i in self.robots]
        return {
            config.name: straight_stop(config, state.command, state.increments)
            for config, state in states
            if _driven(state) and any(state.increments)
        }

    def _stopped(
        self, index: int, message: str, target: Target | None, now_s: float, timed: bool
    ) -> RobotState:
        """The state of a robot that stops in the shortest way, because of ``message``.

        What it followed is refused, a target of a stream until the next; on a trajectory (``timed``) a fault.
        """
        config, before = self._robots.configs[index], self._robots.states[index]
        if before.mode in (Mode.RUN, Mode.APPROACH, Mode.HOLD) and (
            before.goto is not None or before.follow or before.squeeze is not None
        ):
            if before.recovering or (timed and before.goto is None):
                return transitions.too_near(config, before, message, now_s)
            if before.goto is None and target is not None:
                self._refused[index] = target
            self._refuse(config.name, f"{message}; it holds")
            held = before if before.mode is Mode.HOLD else transitions.stay(config, before, now_s)
            held = replace(held, goto=None, follow=held.follow and held.goto is None)
            return braking_at_once(config, held, now_s)
        if before.mode is Mode.STOPPING and before.policy is StopPolicy.REST:
            self._refuse(config.name, f"{message}; it stops where it is instead of at its rest pose")
            before = transitions.stop(config, before, StopPolicy.HOLD, now_s)
        return braking_at_once(config, before, now_s)

    def _refuse(self, name: str, message: str) -> None:
        self._sink.event(OrderRefused(robot=name, message=f"{name}: {message}"))


def _driven(state: RobotState) -> bool:
    """True when the devices obey the command."""
    return bool(state.command) and state.enabled
