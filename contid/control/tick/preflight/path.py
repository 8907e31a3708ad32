"""The whole curve of a trajectory checked before motion: reach, speed and acceleration between its rows.

The run is computed as the tick computes it: the eased clock, the model seeded with the solution before, the
limiter. Refused are targets out of reach and paths on which the limiter would take the tip off its target by
more than `contid.control.tick.next_command.tip_tolerance_m`. Extra axes round the corners of their trajectory
within a few ticks: they must not fall further behind than their greatest speed times `LAG_S`.

Not every tick is computed: see `contid.control.tick.preflight.ticks`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from contid.control.tick.config import RobotConfig
from contid.control.tick.next_command import next_command, tip_tolerance_m
from contid.control.tick.preflight.blocks import BlockSize, clean, takes_blocks, tips_in_base
from contid.control.tick.preflight.jumps import Disturbed, jump_of
from contid.control.tick.preflight.kept_apart import MotionClearance
from contid.control.tick.preflight.reasons import NEAR_M, PathFinding, explain, jump, too_fast, undecided
from contid.control.tick.preflight.ticks import EVERY, SAMPLES, EveryTick, Tick, computes_every, run_ticks
from contid.control.tick.soft_start import ease_ticks
from contid.kinematics.array import Array
from contid.targets import Actuation, Target
from contid.trajectory.timed import Trajectory

#: An extra axis may be behind its reference by its greatest speed times this [s].
LAG_S: Final = 0.02
#: Share of the allowed change of a step between two samples from which an axis may turn a corner there: a
#: corner shows in two changes.
_CORNER: Final = 0.5
_ROUNDING: Final = 1.0 + 1e-6


def path_findings(
    trajectory: Trajectory,
    configs: Sequence[RobotConfig],
    seeds: Mapping[str, Actuation],
    clearance: MotionClearance | None = None,
    progress: Callable[[int], None] | None = None,
) -> Iterator[PathFinding]:
    """Findings in the order of the rows, each with the row on the way to which a robot fails.

    Args:
        trajectory: its rows are within reach.
        configs: of the robots that it moves.
        seeds: actuation of each from which the first row is solved.
        clearance: keeps the bodies apart on the approach from the seeds and on the curve; None without.
        progress: called every 1000 checked ticks with the row reached.
    """
    if not configs:
        return
    lead = ease_ticks(configs, trajectory, trajectory.start_s, ahead=True)
    tail = ease_ticks(configs, trajectory, trajectory.end_s, ahead=False)
    first = trajectory.targets_of_row(0)
    followers = [_Follower(config, first[config.name], seeds[config.name]) for config in configs]
    refused = dict[int, PathFinding]()  # by follower; after them the clearance
    if clearance is not None:
        begin = {f.name: (f.command, first[f.name].load_n) for f in followers}
        message = clearance.approach(begin)
        if message:
            yield PathFinding(f"on the approach to this row, {message}", row=0)
            return

    def corners(samples: Sequence[Tick]) -> set[int]:
        targets = [trajectory.targets_at(each.time_s) for each in samples]
        ticks = [each.ticks for each in samples]
        each_robots = [f.corners([at[f.name] for at in targets], ticks) for f in followers]
        return set[int]().union(*each_robots)

    samples = EVERY if any(_redundant(config) for config in configs) else SAMPLES
    rate_hz = 1.0 / configs[0].period_s
    if clearance is None and _in_blocks(trajectory, configs, rate_hz):
        path = _not_clean(trajectory, EveryTick(trajectory, rate_hz, lead, tail), followers, progress)
    else:
        path = run_ticks(trajectory, rate_hz, lead, tail, corners, samples)
    for count, tick in enumerate(path):
        row = tick.row
        if progress is not None and count % 1000 == 0:
            progress(row)
        if any(found.row < row for found in refused.values()):
            yield from refused.values()
            refused.clear()
        targets = trajectory.targets_at(tick.time_s)
        for index, follower in enumerate(followers):
            found = follower.follow(targets[follower.name], tick.ticks)
            if found and (index not in refused or _severity(found) > _severity(refused[index])):
                message = f"on the way to this row, {found.message}"
                refused[index] = replace(found, row=row, message=message)
        if clearance is not None and len(followers) not in refused:
            reached = {f.name: (f.command, targets[f.name].load_n) for f in followers}
            message = clearance.to(reached, {f.name: f.steps for f in followers})
            if message:
                message = f"on the way to this row, {message}"
                refused[len(followers)] = PathFinding(message, row=row)
    yield from refused.values()


def _in_blocks(trajectory: Trajectory, configs: Sequence[RobotConfig], rate_hz: float) -> bool:
    """True where every tick is computed and blocks of them can be (`blocks`)."""
    simple = not any(map(_redundant, configs)) and computes_every(trajectory, rate_hz)
    return simple and takes_blocks(trajectory, configs)


def _not_clean(
    trajectory: Trajectory,
    ticks: EveryTick,
    followers: Sequence[_Follower],
    progress: Callable[[int], None] | None,
) -> Iterator[Tick]:
    """The ticks that have to be looked at one by one; the followers go through the others by themselves."""
    block, number = BlockSize(), 0
    while number < len(ticks):
        rows = trajectory.values_of_many(ticks.times_s[number : number + block.size])
        answers = [f.clean(tips_in_base(trajectory, f.config, rows)) for f in followers]
        count = min(map(len, answers))
        number += count
        if count:
            targets = trajectory.targets_at(ticks[number - 1].time_s)
            for follower, own in zip(followers, answers, strict=True):
                follower.skip(own[:count], targets[follower.name])
            if progress is not None:
                progress(ticks[number - 1].row)
        end = min(number + block.after(count, len(rows)), len(ticks))
        yield from (ticks[each] for each in range(number, end))
        number = end


def _redundant(config: RobotConfig) -> bool:
    """True with more axes than coordinates of the tip, or with tendons, whose tensions are chosen."""
    own = len(config.axes) - config.extra_axes
    return own > config.model.dimension or config.taut is not None


def _severity(found: PathFinding) -> tuple[float, float]:
    """Order of the findings on the way to one row: out of reach by most, a jump, too fast by most."""
    return found.residual_m, found.slowdown or math.inf


class _Follower:
    """One robot on its way along the curve, as the tick drives it."""

    def __init__(self, config: RobotConfig, first: Target, seed: Actuation) -> None:
        self.name = config.name
        self.config = config
        self._target = config.frame.target_in_base(first)
        self._goal = config.model.inverse(self._target, seed).actuation
        self._disturbed = Disturbed(config, self._goal) if _redundant(config) else None
        #: The actuation reached, and the change of each axis in the tick that reached it [m or Pa].
        self.command = self._goal
        self.steps = self._pace = (0.0,) * len(self._goal)
        self._lag = tuple([each.step * max(1.0, LAG_S / config.period_s) for each in config.limits])
        #: Greatest step and change of step of each axis since the command was last on the curve.
        self._peaks = [(0.0, 0.0) for _ in self._goal]

    def clean(self, tips: Array) -> Array:
        """Answers to the first of these tips, one a tick, that a check has nothing to find in."""
        if self.command != self._goal:
            return np.empty((0, len(self._goal)))
        return clean(self.config, tips, self.command, self.steps)

    def skip(self, answers: Array, target: Target) -> None:
        """Go to ``target``, in the world, through such answers."""
        before = self.command if len(answers) == 1 else tuple(answers[-2].tolist())
        self.command = self._goal = tuple(answers[-1].tolist())
        self.steps = self._pace = tuple([new - old for new, old in zip(self.command, before, strict=True)])
        self._target = self.config.frame.target_in_base(target)
        self._peaks = [(0.0, 0.0) for _ in self._goal]

    def corners(self, targets: Sequence[Target], ticks: Sequence[int]) -> set[int]:
        """Indices of targets before which an axis may change its speed by more than it can in a tick.

        Args:
            targets: that follow the one reached.
            ticks: from the one before to each of them.
        """
        config, found = self.config, set[int]()
        seed, goal, pace = self.command, self._goal, self._pace
        for index, (target, apart) in enumerate(zip(targets, ticks, strict=True)):
            try:
                answer = config.model.inverse(config.frame.target_in_base(target), seed).actuation
            except ValueError:
                return found  # it is refused there
            steps = tuple([(new - old) / apart for new, old in zip(answer, goal, strict=True)])
            changes = zip(steps, pace, config.limits, strict=True)
            if any(abs(new - old) > _CORNER * each.change for new, old, each in changes):
                found |= {index - 1, index}
            seed, goal, pace = answer, answer, steps
        return found

    def follow(self, target: Target, ticks: int) -> PathFinding | None:
        """Go to the target, ``ticks`` ticks after the one before; returns why that fails, or None."""
        config = self.config
        in_base = config.frame.target_in_base(target)
        try:
            solution = config.model.inverse(in_base, self.command)
        except ValueError as error:
            return PathFinding(f"{config.name}: {error}")
        goal = solution.actuation
        pace = tuple([(new - old) / ticks for new, old in zip(goal, self._goal, strict=True)])
        changes = [new - old for new, old in zip(pace, self._pace, strict=True)]
        self._peaks = [
            (max(step, abs(new)), max(sharp, abs(change)))
            for (step, sharp), new, change in zip(self._peaks, pace, changes, strict=True)
        ]
        before, self._target = (self._target, self._goal), in_base
        self._goal, self._pace = goal, pace
        if ticks == 1:
            command, flags, _ = next_command(config, self.command, self.steps, goal, pace, in_base)
            behind = [0.0] if command == goal else self._behind(command, goal, in_base)
        else:
            # The ticks between were not computed; without a corner only speed can be too much.
            command, flags = goal, ()
            behind = [abs(step) / each.step for step, each in zip(pace, config.limits, strict=True)]
        self.steps = tuple([new - old for new, old in zip(command, self.command, strict=True)])
        self.command = command
        worst = max(range(len(behind)), key=behind.__getitem__)
        found = None
        parts = self._disturbed is not None and self._disturbed.parts(in_base, goal)
        if not solution.converged and (solution.residual_m > NEAR_M or target.extra):
            found = PathFinding(explain(config, target, solution), residual_m=solution.residual_m)
        elif behind[worst] > _ROUNDING:
            jumps = jump_of(config, before[0], in_base, (before[1], goal)) if ticks == 1 else None
            found = (
                too_fast(config, worst, *self._peaks[worst])
                if jumps is None
                else jump(config, jumps, goal[jumps] - before[1][jumps], target)
            )
        elif parts:
            found = undecided(config, target)
        if found or ticks > 1:
            self.command, self.steps = goal, pace
        if found or not any(flags):
            self._peaks = [(0.0, 0.0) for _ in goal]
        return found

    def _behind(self, command: Actuation, goal: Actuation, in_base: Target) -> list[float]:
        """How far each axis is behind, 1.0 being the most that is allowed.

        For the axes of the model that is the distance of the tip over its tolerance, on the axis that is
        furthest behind; 0 for the others.
        """
        config = self.config
        forward, own = config.model.forward, len(goal) - config.extra_axes
        off_m = math.dist(forward(command, in_base.load_n).tip_m, forward(goal, in_base.load_n).tip_m)
        behind = [abs(a - b) / lag for a, b, lag in zip(goal, command, self._lag, strict=True)]
        furthest = max(range(own), key=behind.__getitem__)
        behind[:own] = [0.0] * own
        behind[furthest] = off_m / tip_tolerance_m(config.quantity)
        return behind
