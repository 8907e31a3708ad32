"""Checks every row of a trajectory before any motion and lists the unreachable ones."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from contid.control.tick.config import RobotConfig
from contid.control.tick.preflight.blocks import BlockSize, reached, takes_blocks, tips_in_base
from contid.control.tick.preflight.kept_apart import ChecksClearance, ChecksRope
from contid.control.tick.preflight.path import path_findings
from contid.control.tick.preflight.reasons import PathFinding, explain, slower
from contid.errors import BadInputError, Located
from contid.targets import ZERO3, Actuation, Target, Tip
from contid.trajectory.timed import Trajectory
from contid.units import m_to_mm

#: Refused rows that are listed one by one; the last finding counts them all.
MAX_LISTED: Final = 5
#: Interval between checks of a rope along a path, in which tips at 0.5 m/s move 10 mm; in a long interval
#: between two rows, this many checks: tips move less from one to the next.
SAMPLE_INTERVAL_S: Final = 0.02
MAX_SAMPLES: Final = 1000

#: When every position of a refused trajectory is within this distance of the origin [m], its columns in mm
#: probably hold metres.
METRES_M: Final = 2e-3
#: Share of the rows from which repeated ones are held samples, as of 50 Hz motion capture logged at 100 Hz.
HELD_SHARE: Final = 0.1


class Unreachable(enum.StrEnum):
    """What to do with a target that the robot cannot reach."""

    REFUSE = "refuse"  # a file is not run; a row of a live stream holds its robot
    NEAREST = "nearest"  # go to the reachable point the model answers, and count it


class TooFastError(BadInputError):
    """Robots can reach every row, but not in its time.

    Attributes:
        slowdown: at least how many times slower the worst part has to be.
    """

    def __init__(self, findings: Sequence[Located], slowdown: float) -> None:
        self.slowdown = slowdown
        super().__init__(findings)


class Preflight:
    """Checks rows with the models, each seeded with the solution before, and with the guards of chains.

    The tick solves again with the last command as seed, and limits the motion towards the solution.

    Args:
        configs: of the robots.
        guards: of the closed chains among them.
        unreachable: with NEAREST only the guards refuse, judging the reachable points.
        seeds: where robots are now; without one a robot is at its rest pose.
        clearance: keeps bodies apart; None without.
    """

    def __init__(
        self,
        configs: Sequence[RobotConfig],
        guards: Sequence[ChecksRope] = (),
        unreachable: Unreachable = Unreachable.REFUSE,
        seeds: Mapping[str, Actuation] | None = None,
        clearance: ChecksClearance | None = None,
    ) -> None:
        self._configs = {config.name: config for config in configs}
        self._start = {config.name: config.rest for config in configs} | dict(seeds or {})
        self._seeds = dict(self._start)
        self._guards = guards
        self._clearance = None if clearance is None else clearance.preflight(configs, self._seeds)
        self._refuses = unreachable is Unreachable.REFUSE
        # Tips of the arms of chains after the last accepted row; at rest before the first.
        self._tips = {arm: self._tip(arm, self._seeds[arm]) for guard in guards for arm in guard.arms}
        # Greatest residual among the targets that the newest row was refused for.
        self._missed_m = 0.0

    def row(self, targets: Mapping[str, Target | None]) -> dict[str, str]:
        """By robot, why it cannot follow this row; empty when all can."""
        seeds, tips = dict(self._seeds), self._tips
        wrong = self._row(targets, self._refuses)
        if self._clearance is None:
            return wrong
        goals = {
            name: (self._seeds[name], target.load_n)
            for name, target in targets.items()
            if target is not None and name in self._configs and name not in wrong
        }
        message = self._clearance.approach(goals)
        if message:
            self._seeds, self._tips = seeds, tips
            wrong |= dict.fromkeys(goals, message)
        return wrong

    def _row(self, targets: Mapping[str, Target | None], refuses: bool) -> dict[str, str]:
        """`row` without the clearance; with ``refuses`` False only the ropes of chains refuse."""
        wrong = {}
        tips = dict(self._tips)
        self._missed_m = 0.0
        for name, target in targets.items():
            config = self._configs.get(name)
            if config is None or target is None:
                continue
            try:
                solution = config.model.inverse(config.frame.target_in_base(target), self._seeds[name])
            except ValueError as error:
                wrong[name] = f"{name}: {error}"
                continue
            if not solution.converged and refuses:
                wrong[name] = explain(config, target, solution)
                self._missed_m = max(self._missed_m, solution.residual_m)
                continue
            self._seeds[name] = solution.actuation
            if name in tips:
                tips[name] = self._tip(name, solution.actuation, target)
        for guard in self._guards:
            state = guard.check(tips)
            if state.feasible:
                continue
            for arm in guard.arms:
                if arm in targets:
                    wrong.setdefault(arm, f"{guard.name}: {state.reason}")
                tips[arm] = self._tips[arm]
        self._tips = tips
        return wrong

    def _tip(self, name: str, actuation: Actuation, target: Target | None = None) -> Tip:
        """Tip and direction of an arm in the world."""
        config = self._configs[name]
        load_in_base = ZERO3 if target is None else config.frame.vector_in_base(target.load_n)
        pose = config.model.forward(actuation, load_in_base)
        return config.frame.point_in_world(pose.tip_m), config.frame.vector_in_world(pose.direction)

    def between_rows(self, trajectory: Trajectory, index: int) -> dict[str, str]:
        """Why a chain forbids the way from the row before to this one; empty when it does not.

        Rows may be far apart: a rope is checked every `SAMPLE_INTERVAL_S`, or `MAX_SAMPLES` times.
        """
        if not self._guards or index == 0:
            return {}
        start_s, end_s = trajectory.time_of_row(index - 1), trajectory.time_of_row(index)
        samples = min(math.ceil((end_s - start_s) / SAMPLE_INTERVAL_S), MAX_SAMPLES)
        seeds, tips = dict(self._seeds), self._tips
        try:
            for k in range(1, samples):
                targets = trajectory.targets_at(start_s + (end_s - start_s) * k / samples)
                # A model's nearest point between two good rows is what the tick follows.
                wrong = self._row(targets, refuses=False)
                if wrong:
                    return {name: f"on the way to this row, {message}" for name, message in wrong.items()}
        finally:
            self._seeds, self._tips = seeds, tips
        return {}

    def trajectory(
        self, trajectory: Trajectory, name: str, progress: Callable[[int, int], None] | None = None
    ) -> Trajectory:
        """Check every row, then the curve between them; the trajectory, marked when all is within reach.

        Raises:
            TooFastError: every row is within reach, but the rates of a robot do not allow the curve.
            BadInputError: rows that cannot be reached or that a chain forbids, or a curve between rows that
                leaves the reach of a robot. The first rows are listed with their lines, then all counted.
        """
        before = dict(self._seeds)
        refused = _Refused(trajectory, name)
        total = len(trajectory)
        for index in self._not_clean(trajectory):
            if progress is not None and index % 1000 == 0:
                progress(index, total)
            wrong = self.between_rows(trajectory, index) or self._row(
                trajectory.targets_of_row(index), self._refuses
            )
            for message in dict.fromkeys(wrong.values()):
                refused.add(PathFinding(message, residual_m=self._missed_m, row=index))
        if refused.rows:
            findings = refused.findings()
            if _looks_like_metres(trajectory):
                hint = (
                    f"{findings[-1].message}; every position is below 2 mm: are these metres in a mm column?"
                )
                findings[-1] = replace(findings[-1], message=hint)
            raise BadInputError(findings)
        if not self._refuses:
            return trajectory
        report = None if progress is None else lambda row: progress(row, total)
        for found in path_findings(trajectory, self._moved(trajectory), before, self._clearance, report):
            refused.add(found)
        if refused.rows:
            slowdown = max(found.slowdown for found in refused.worst.values())
            too_fast = all(found.slowdown for found in refused.worst.values())
            raise (
                TooFastError(refused.findings(), slowdown) if too_fast else BadInputError(refused.findings())
            )
        return trajectory.accepted()

    def _not_clean(self, trajectory: Trajectory) -> Iterator[int]:
        """The rows that have to be looked at one by one: all but blocks that are within reach (`blocks`)."""
        moved = self._moved(trajectory)
        if self._guards or not takes_blocks(trajectory, moved):
            yield from range(len(trajectory))
            return
        block, index = BlockSize(), 0
        while index < len(trajectory):
            rows = trajectory.rows[index : index + block.size]
            answers = [
                reached(each, tips_in_base(trajectory, each, rows), self._seeds[each.name]) for each in moved
            ]
            count = min(map(len, answers))
            if count:
                self._seeds |= {
                    each.name: tuple(own[count - 1].tolist())
                    for each, own in zip(moved, answers, strict=True)
                }
            index += count
            singles = block.after(count, len(rows))
            yield from range(index, min(index + singles, len(trajectory)))
            index += singles

    def follows(self, trajectory: Trajectory, name: str) -> bool:
        """True when the rates of the robots allow the curve, whose rows were checked before.

        It returns at the first place that they do not allow.

        Raises:
            BadInputError: what is in the way there does not depend on the speed.
        """
        for found in path_findings(trajectory, self._moved(trajectory), self._start):
            if not found.slowdown:
                raise BadInputError([Located(name, trajectory.lines[found.row], 1, found.message)])
            return False
        return True

    def _moved(self, trajectory: Trajectory) -> list[RobotConfig]:
        """The robots that a trajectory moves."""
        return [self._configs[each] for each in trajectory.targets_of_row(0) if each in self._configs]


class _Refused:
    """The refused rows of a trajectory."""

    def __init__(self, trajectory: Trajectory, name: str) -> None:
        self._trajectory = trajectory
        self._name = name
        self._listed: list[PathFinding] = []
        self.rows: set[int] = set()
        #: By kind (too fast or out of reach) the worst finding.
        self.worst: dict[bool, PathFinding] = {}

    def add(self, found: PathFinding) -> None:
        """Count a finding."""
        if len(self._listed) < MAX_LISTED:
            self._listed.append(found)
        self.rows.add(found.row)
        too_fast = found.slowdown > 0.0
        worst = self.worst.get(too_fast)
        if worst is None or (found.slowdown, found.residual_m) > (worst.slowdown, worst.residual_m):
            self.worst[too_fast] = found

    def findings(self) -> list[Located]:
        """The first ones, and where there are more a last one that counts all and has the worst."""
        found = [self._located(each.row, each.message) for each in self._listed]
        if len(self.rows) <= 1:
            return found
        what = "too fast" if self.worst.keys() == {True} else "refused"
        total = len(self._trajectory)
        message = (
            f"{len(self.rows)} of {total} rows are {what}, the first on line {self._line(min(self.rows))}"
        )
        place = max(self.rows)
        if self.worst.keys() == {True}:
            place = self.worst[True].row
            message += f"; the worst is this one: {slower(self.worst[True].slowdown)}"
            if (held := _held_rows(self._trajectory)) > HELD_SHARE * total:
                message += (
                    f"; {held} rows in motion repeat the row before (samples were held): leave them out"
                )
        elif self.worst[False].residual_m > 0.0:
            place = self.worst[False].row
            message += f"; the worst is this one, by {m_to_mm(self.worst[False].residual_m):.3g} mm"
        return [*found, self._located(place, message)]

    def _located(self, row: int, message: str) -> Located:
        return Located(self._name, self._line(row), 1, message)

    def _line(self, row: int) -> int:
        return self._trajectory.lines[row]


def _held_rows(trajectory: Trajectory) -> int:
    """Rows that repeat the row before, with motion to the row before that and to the next one."""
    columns = [index for robot in trajectory.layout.robots for index in robot.moving]
    stands = (np.diff(trajectory.rows[:, columns], axis=0) == 0.0).all(axis=1)
    return int(np.count_nonzero(stands[1:-1] & ~stands[:-2] & ~stands[2:]))


def _looks_like_metres(trajectory: Trajectory) -> bool:
    """True when every tip of a trajectory is within `METRES_M` of the origin of the world."""
    for index in range(len(trajectory)):
        for target in trajectory.targets_of_row(index).values():
            if target.tip_m is None or max(map(abs, target.tip_m)) > METRES_M:
                return False
    return True
