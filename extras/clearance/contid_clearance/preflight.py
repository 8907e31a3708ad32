"""Keeps bodies apart on motions that are known before they begin: approaches, moves, trajectories."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from contid.control.tick.axis_motions import PresentRates, motion_to, straight_stop
from contid.control.tick.config import RobotConfig
from contid.control.tick.preflight.kept_apart import Configuration
from contid.targets import ZERO3, Actuation, Vec3
from contid_clearance.arm import Motion
from contid_clearance.guard import ClearanceGuard
from contid_clearance.walk import Walk

#: Interval between the computed configurations of an approach; the motion between them is bounded [s].
INTERVAL_S: Final = 0.02


class ClearancePreflight:
    """Moves the robots of a guard as the tick moves them, and checks their distances (`Walk`).

    Args:
        guard: what is kept apart.
        configs: of all robots.
        seeds: where robots are; without one a robot is at its rest pose.
    """

    def __init__(
        self, guard: ClearanceGuard, configs: Sequence[RobotConfig], seeds: Mapping[str, Actuation]
    ) -> None:
        self._guard = guard
        self._configs = {config.name: config for config in configs if config.name in guard.arms}
        no_force = ZERO3
        start = {name: (seeds.get(name, config.rest), no_force) for name, config in self._configs.items()}
        self.walk = Walk(guard, start)

    def approach(self, goals: Configuration) -> str:
        """Move all robots of ``goals`` there at once, from standstill, under the forces of ``goals``.

        Returns why that comes too near, or ""; after a refusal the robots are where they were.
        """
        goals = {name: goal for name, goal in goals.items() if name in self._configs}
        start = self.walk.configuration
        if self.walk.has_room(
            {name: self._greatest_motion(name, start[name], goals[name]) for name in goals}
        ):
            return self.walk.to(goals)
        motions = {}
        for name, (goal, _) in goals.items():
            here, _ = start[name]
            motions[name] = motion_to(self._configs[name], here, PresentRates.at_rest(len(here)), goal)
        duration_s = max((motion.duration_s for motion in motions.values()), default=0.0)
        intervals = max(1, math.ceil(duration_s / INTERVAL_S))
        for k in range(1, intervals + 1):
            time_s = duration_s * k / intervals
            reached: dict[str, tuple[Actuation, Vec3]] = {}
            steps: dict[str, Actuation] = {}
            for name, motion in motions.items():
                actuation, velocity = motion.at(time_s)
                _, force_n = goals[name]
                reached[name] = (actuation, force_n)
                steps[name] = tuple([each * self._configs[name].period_s for each in velocity])
            message = self.to(reached, steps)
            if message:
                self.walk = Walk(self._guard, start)
                return message
        return ""

    def _greatest_motion(
        self, name: str, start: tuple[Actuation, Vec3], goal: tuple[Actuation, Vec3]
    ) -> Motion:
        """At least the motion of a robot from rest to a goal, and in a stop begun on its way.

        Infinite with another force, which is a step.

        On a way d the speed of an axis is at most sqrt(a d). In a stop from there it goes half its speed
        times the duration, which is that of the axis with the longest stop: sqrt(d / a) at most.
        """
        if start[1] != goal[1]:
            return Motion(math.inf, math.inf)
        config = self._configs[name]
        ways = [abs(b - a) for a, b in zip(start[0], goal[0], strict=True)]
        stop_s = max([math.sqrt(d / a) for d, a in zip(ways, config.acceleration, strict=True)])
        stops = [0.5 * math.sqrt(d * a) * stop_s for d, a in zip(ways, config.acceleration, strict=True)]
        return self._guard.arms[name].motion([way + stop for way, stop in zip(ways, stops, strict=True)])

    def to(self, reached: Configuration, steps: Mapping[str, Actuation]) -> str:
        """Move on to a configuration; ``steps``: displacements per tick there [m or Pa], by robot.

        Returns why the configuration, or a stop from it, comes too near, or "".
        """
        message = self.walk.to(reached)
        if message:
            return message
        return self.walk.stops(
            {
                name: straight_stop(config, self.walk.configuration[name][0], steps[name])
                for name, config in self._configs.items()
                if any(steps.get(name, ()))
            }
        )
