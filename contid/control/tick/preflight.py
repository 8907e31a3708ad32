"""Checks every row of a trajectory before any motion and lists the unreachable ones."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import islice
from typing import Final

from contid.control.tick.config import RobotConfig
from contid.control.tick.path_preflight import PathPreflight
from contid.errors import BadInputError, Located
from contid.kinematics.rope.chain import ChainGuard, Tip
from contid.targets import ZERO3, Actuation, Solution, Target
from contid.trajectory.timed import Trajectory
from contid.units import m_to_mm

MAX_FINDINGS: Final = 20
#: Interval between checks of a rope along a path; tips at 0.5 m/s move 10 mm in it.
SAMPLE_INTERVAL_S: Final = 0.02


class Unreachable(enum.StrEnum):
    """What to do with a target that the robot cannot reach."""

    REFUSE = "refuse"  # a file is not run; a row of a live stream holds its robot
    NEAREST = "nearest"  # go to the reachable point the model answers, and count it


class Preflight:
    """Checks rows with the models, each seeded with the solution before, and with the guards of chains.

    The tick solves again with the last command as seed, and limits the motion towards the solution.

    Args:
        configs: of the robots.
        guards: of the closed chains among them.
        unreachable: with NEAREST only the guards refuse, judging the reachable points.
        seeds: where robots are now; without one a robot is at its rest pose.
    """

    def __init__(
        self,
        configs: Sequence[RobotConfig],
        guards: Sequence[ChainGuard] = (),
        unreachable: Unreachable = Unreachable.REFUSE,
        seeds: Mapping[str, Actuation] | None = None,
    ) -> None:
        self._configs = {config.name: config for config in configs}
        self._seeds = {config.name: config.rest for config in configs} | dict(seeds or {})
        self._guards = guards
        self._refuses = unreachable is Unreachable.REFUSE
        # Tips of the arms of chains after the last accepted row; at rest before the first.
        self._tips = {arm: self._tip(arm, self._seeds[arm]) for guard in guards for arm in guard.arms}

    def row(self, targets: Mapping[str, Target | None]) -> dict[str, str]:
        """By robot, why it cannot follow this row; empty when all can."""
        return self._row(targets, self._refuses)

    def _row(self, targets: Mapping[str, Target | None], refuses: bool) -> dict[str, str]:
        """The same; without ``refuses`` only chains refuse."""
        wrong = {}
        tips = dict(self._tips)
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

        Rows may be far apart: a rope is checked at least every `SAMPLE_INTERVAL_S`.
        """
        if not self._guards or index == 0:
            return {}
        start_s, end_s = trajectory.time_of_row(index - 1), trajectory.time_of_row(index)
        samples = math.ceil((end_s - start_s) / SAMPLE_INTERVAL_S)
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
    ) -> None:
        """Check every row, then the curve between them.

        Raises:
            BadInputError: rows that cannot be reached or that a chain forbids, or a curve between rows that
                leaves the reach or the rates of a robot; each with its line.
        """
        seeds = dict(self._seeds)
        findings: list[Located] = []
        total = len(trajectory)
        for index in range(total):
            if progress is not None and index % 1000 == 0:
                progress(index, total)
            wrong = self.between_rows(trajectory, index) or self.row(trajectory.targets_of_row(index))
            for message in dict.fromkeys(wrong.values()):
                findings.append(Located(name, trajectory.line_of_row(index), 1, message))
            if len(findings) >= MAX_FINDINGS:
                message = f"{MAX_FINDINGS} refused targets so far; not checked further"
                findings.append(Located(name, trajectory.line_of_row(index), 1, message))
                break
        if not findings and self._refuses:
            moved = [self._configs[each] for each in trajectory.targets_of_row(0) if each in self._configs]
            path = PathPreflight(moved, [seeds[config.name] for config in moved], explain)
            report = None if progress is None else lambda row: progress(row, total)
            findings = [
                Located(name, trajectory.line_of_row(row), 1, message)
                for row, message in islice(path.findings(trajectory, report), MAX_FINDINGS)
            ]
        if findings:
            raise BadInputError(findings)


def explain(config: RobotConfig, target: Target, solution: Solution) -> str:
    """Which columns of which robot, which limit, and by how much."""
    where = "actuation" if target.actuation is not None else "tip"
    limits = f" (limited by {', '.join(solution.limited_by)})" if solution.limited_by else ""
    note = f"; {solution.note}" if solution.note else ""
    miss = "" if target.actuation is not None else f" by {m_to_mm(solution.residual_m):.6g} mm"
    return f"{config.name}: {where} {_shown(config, target)} is out of reach{miss}{limits}{note}"


def _shown(config: RobotConfig, target: Target) -> str:
    if target.actuation is not None:
        unit = config.quantity.unit
        return "(" + ", ".join(f"{v * config.quantity.per_si:.6g}" for v in target.actuation) + f") {unit}"
    return "(" + ", ".join(f"{m_to_mm(v):.6g}" for v in target.tip_m or ()) + ") mm"
