"""Nothing moves before every row was found reachable; those that are not are named in words."""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from contid.control.plan import RobotPlan
from contid.errors import BadInputError, Located
from contid.targets import Solution, Target
from contid.trajectory.timed import Trajectory
from contid.units import m_to_mm

MAX_FINDINGS: Final = 20


class Unreachable(enum.StrEnum):
    """What to do with a target that the robot cannot reach."""

    REFUSE = "refuse"  # a file is not run; a row of a live stream holds its robot
    NEAREST = "nearest"  # go to the reachable point the model answers, and count it


class Preflight:
    """Asks the models, seeded with the answer before, exactly as the tick will."""

    def __init__(self, plans: Sequence[RobotPlan]) -> None:
        self._plans = {plan.name: plan for plan in plans}
        self._seeds = {plan.name: plan.rest for plan in plans}

    def row(self, targets: Mapping[str, Target | None]) -> dict[str, str]:
        """Why which robots cannot follow this row; empty when all can."""
        wrong = {}
        for name, target in targets.items():
            plan = self._plans.get(name)
            if plan is None or target is None:
                continue
            try:
                solution = plan.model.inverse(plan.frame.target_in_base(target), self._seeds[name])
            except ValueError as error:
                wrong[name] = f"{name}: {error}"
                continue
            if solution.converged:
                self._seeds[name] = solution.actuation
            else:
                wrong[name] = explain(plan, target, solution)
        return wrong

    def trajectory(
        self, trajectory: Trajectory, name: str, progress: Callable[[int, int], None] | None = None
    ) -> None:
        """Check every row.

        Raises:
            BadInputError: rows that cannot be reached, each with its line.
        """
        findings: list[Located] = []
        total = len(trajectory)
        for index in range(total):
            if progress is not None and index % 1000 == 0:
                progress(index, total)
            for words in self.row(trajectory.targets_of_row(index)).values():
                findings.append(Located(name, trajectory.line_of_row(index), 1, words))
            if len(findings) >= MAX_FINDINGS:
                words = f"{MAX_FINDINGS} unreachable targets so far; not checked further"
                findings.append(Located(name, trajectory.line_of_row(index), 1, words))
                break
        if findings:
            raise BadInputError(findings)


def explain(plan: RobotPlan, target: Target, solution: Solution) -> str:
    """Which columns of which robot, which limit, and by how much."""
    where = "actuation" if target.actuation is not None else "tip"
    limits = f" (limited by {', '.join(solution.limited_by)})" if solution.limited_by else ""
    note = f"; {solution.note}" if solution.note else ""
    miss = "" if target.actuation is not None else f" by {m_to_mm(solution.residual_m):.6g} mm"
    return f"{plan.name}: {where} {_shown(plan, target)} is out of reach{miss}{limits}{note}"


def _shown(plan: RobotPlan, target: Target) -> str:
    if target.actuation is not None:
        unit = plan.quantity.unit
        return "(" + ", ".join(f"{v * plan.quantity.per_si:.6g}" for v in target.actuation) + f") {unit}"
    return "(" + ", ".join(f"{m_to_mm(v):.6g}" for v in target.tip_m or ()) + ") mm"
