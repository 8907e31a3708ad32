"""Numbers of the solver of a chain of sections, scaled to the size of the robot."""

from __future__ import annotations

from dataclasses import dataclass

from contid.kinematics.arc.feasible import Feasible


@dataclass(frozen=True, slots=True)
class Tuning:
    """Numbers of the solver.

    Attributes:
        ell_m: length that scales damping and direction rows [m].
        tolerance_m: error at which a target is met [m].
        home_tolerance_m: step at which the redundancy counts as settled [m].
        weight: w, least damping, and bound of the multipliers where the task is singular.
        near: homing starts below ``near * ell_m`` of error.
        home_steps: maximum number of homing steps; twice as many near obstacles.
        contraction: where homing steps shrink less than by this factor, their metric gets the curvature.
        slow: a damped step that leaves more than this share of the error ends the approach.
        iterations: maximum number of damped steps per start.
        settling: maximum number of Newton steps per start, for a target that is not met.
        starts: maximum number of starts after the seed, for a target that is not met.
        agreeing: number of starts ending at the best answer that ends the search for a target beyond the
            length of the arm; within its length every start is tried.
        tracking: a descent from the seed that moves less than ``tracking * ell_m`` without meeting its target
            follows a bounded optimum from tick to tick: then at most ``agreeing`` starts, to stay in time.
        still_m: a seed that meets its target within ``still_error_m`` [m] is kept where the first step is
            shorter [m]: an answer solved again from itself does not move.
        still_error_m: see ``still_m``.
    """

    ell_m: float
    tolerance_m: float = 1e-6
    home_tolerance_m: float = 1e-8
    weight: float = 1e-8
    near: float = 0.3
    home_steps: int = 60
    contraction: float = 0.3
    slow: float = 0.95
    iterations: int = 60
    settling: int = 80
    starts: int = 32
    agreeing: int = 3
    tracking: float = 0.1
    still_m: float = 1e-8
    still_error_m: float = 1e-10


def tuning_for(feasible: Feasible) -> Tuning:
    """Numbers scaled to the size of the robot: ``ell`` is a fifth of the arm in its home posture."""
    return Tuning(ell_m=0.2 * (float(feasible.home.sum()) / 3.0 + sum(feasible.sections.rigid_m)))
