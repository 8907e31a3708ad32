"""Keeps bodies apart in every tick, whatever moves them: targets, feedback, stops through the rest pose.

A tick is allowed when every pair keeps the margin at its commands, and keeps it too if all robots stop from
there. Otherwise the robots of the pair stop in this tick, from the commands of the one before, for which that
was certain. So a robot in motion always has room to stop. That stop decelerates at the limit of its axes
(`contid.trajectory.straight_stop`).

A robot without power is where its samples are. Everything is a function of configurations, states and
samples, so a replay decides the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

from contid.clearance.guard import ClearanceGuard
from contid.clearance.walk import RESOLUTION_M, Walk
from contid.control.tick.axis_motions import straight_stop
from contid.control.tick.config import RobotConfig
from contid.control.tick.robot_tick import TickResult
from contid.control.tick.state import RobotState
from contid.hal import Sample
from contid.targets import ZERO3, Actuation, Target, Vec3
from contid.trajectory.straight_stop import StraightStop

#: Samples of a robot in the order of its axes, empty when there are none.
Samples: TypeAlias = Callable[[RobotConfig], tuple[Sample, ...]]
#: Result of the tick of a robot that stops it, by its index and why.
Stopped: TypeAlias = Callable[[int, str], TickResult]


class ClearanceWatch:
    """The bodies of a file as the tick commands them.

    Args:
        guard: what is kept apart.
        configs: of all robots.
    """

    def __init__(self, guard: ClearanceGuard, configs: Sequence[RobotConfig]) -> None:
        self._guard = guard
        self._configs = tuple(configs)
        self._walk: Walk | None = None
        self._loads: dict[str, Vec3] = dict.fromkeys(guard.arms, ZERO3)
        self._driven: dict[str, bool] = {}

    def allowed(
        self,
        outcomes: list[TickResult],
        targets: Mapping[str, Target | None],
        samples: Samples,
        stopped: Stopped,
    ) -> None:
        """Replace the results of robots that come too near by results that stop them.

        Args:
            outcomes: of the tick, by robot; changed in place.
            targets: of the tick.
            samples: of a robot.
            stopped: computes the replacement from the state before the tick.
        """
        for name in self._guard.arms:
            target = targets.get(name)
            if target is not None:
                self._loads[name] = target.load_n
        walk = self._placed(outcomes, samples)
        held: set[int] = set()
        while True:
            ahead = walk.copy()
            message = ahead.to(self._configuration(outcomes, ahead)) or ahead.stops(
                self._stops(outcomes), RESOLUTION_M
            )
            if not message:
                self._walk = ahead
                return
            pair = [i for i, config in enumerate(self._configs) if config.name in ahead.refused]
            moving = [i for i in pair if i not in held and any(outcomes[i].state.increments)]
            for i in moving:
                outcomes[i] = stopped(i, message)
            held.update(moving)
            if not moving:  # every robot of the pair stops already
                walk.place({**walk.configuration, **self._configuration(outcomes, walk)})
                self._walk = walk
                return

    def _placed(self, outcomes: Sequence[TickResult], samples: Samples) -> Walk:
        """The walk at the last commands, or at the samples of robots without power."""
        walk = self._walk
        now = {} if walk is None else dict(walk.configuration)
        jumped = walk is None
        for config, outcome in zip(self._configs, outcomes, strict=True):
            name = config.name
            if name not in self._guard.arms:
                continue
            driven = _driven(outcome.state)
            if driven and self._driven.get(name, False):
                continue
            self._driven[name] = driven
            at = outcome.state.command if driven else _measured(config, samples(config))
            if name not in now:
                now[name] = (at or config.rest, ZERO3)
            elif at and self._guard.arms[name].motion_m(now[name][0], at) > RESOLUTION_M:
                now[name], jumped = (at, now[name][1]), True
        if walk is None:
            return Walk(self._guard, now)
        if jumped:
            walk.place(now)
        return walk

    def _configuration(self, outcomes: Sequence[TickResult], walk: Walk) -> dict[str, tuple[Actuation, Vec3]]:
        return {
            config.name: (outcome.state.command, self._loads[config.name])
            for config, outcome in zip(self._configs, outcomes, strict=True)
            if config.name in self._guard.arms and _driven(outcome.state)
        }

    def _stops(self, outcomes: Sequence[TickResult]) -> dict[str, StraightStop]:
        return {
            config.name: straight_stop(config, outcome.state.command, outcome.state.increments)
            for config, outcome in zip(self._configs, outcomes, strict=True)
            if config.name in self._guard.arms and _driven(outcome.state) and any(outcome.state.increments)
        }


def _driven(state: RobotState) -> bool:
    """True when the devices obey the command."""
    return bool(state.command) and state.enabled


def _measured(config: RobotConfig, samples: Sequence[Sample]) -> Actuation:
    """The actuation of valid samples, () without."""
    values = [sample.value for sample in samples if sample.valid and sample.value is not None]
    if len(values) < len(config.axes):
        return ()
    return config.transmission.to_actuation(tuple(values))
