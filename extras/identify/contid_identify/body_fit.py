"""Stage *body*: mass, damping and delay of a moving rod, by output error over the twin.

    min over p of sum over decays |tip measured(t) - c - tip simulated(t; p)|^2

The twin (`contid_dynamics.arm.MovingArm`) is driven by what the devices measured, late by a dead time, from
its equilibrium before the move on; a constant c of each decay takes what the statics of the file leave over.
Statics fix stiffness; a free swing fixes only its quotient by the mass, so stiffness stays that of the file.
Mass is sought as one factor for everything that moves, masses on the tip too. Values that end more than four
standard deviations of the prior from the file are refused.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.dynamics import Dynamics
from contid.robot_file.robot import RobotDescription
from contid.robot_file.tendon.robot import TendonRobot
from contid_dynamics.arm import MovingArm
from contid_identify.answer import between
from contid_identify.delay_lag import JudgedStage
from contid_identify.estimate import Interval, error_of, estimate
from contid_identify.recording import RobotRecording
from contid_identify.ring_down import Decay
from contid_identify.split import decay_blocks

#: Steps of the twin [s].
_STEP_S: Final = 4e-3
#: Of a decay this much is simulated, with this much before it, in which older swings die out [s].
_DECAY_S: Final = 2.5
_BEFORE_S: Final = 6.0
#: Standard deviations of the logarithms of mass and damping about the file, and how many are accepted.
_PRIOR: Final = (math.log(1.5), math.log(2.5))
_ACCEPTED: Final = 4.0


@dataclass(frozen=True, eq=False)
class BodyFit:
    """The body of a robot in motion.

    Attributes:
        mass: factor of the masses of the file.
        damping_s: time of Kelvin and Voigt.
        delay_s: dead time between what the devices measured and the body.
        stages: the body of the file, and the fitted one; errors [m].
        decays: numbers of decays of the fit, and kept out.
    """

    mass: Interval
    damping_s: Interval
    delay_s: Interval
    stages: tuple[JudgedStage, ...]
    decays: tuple[int, int]


@dataclass(frozen=True, eq=False)
class _Move:
    """One move and the swing behind it: inputs of the twin at equal steps, and the tips to meet."""

    driven: Array
    at_s: Array
    tip_m: Array


def fit_body(
    robot: RobotDescription, recordings: Sequence[RobotRecording], decays: Sequence[Sequence[Decay]]
) -> BodyFit:
    """Mass and damping from ring-downs.

    Args:
        robot: description with ``dynamics``.
        recordings: of it.
        decays: of each recording. Every other one is kept out where there are several.

    Raises:
        ContidError: no moving body, no decay, or values too far from those of the file.
    """
    if not isinstance(robot, (Cosserat, TendonRobot)) or robot.dynamics is None:
        raise ContidError("body: the file has no `dynamics`, see docs/robots/dynamics.md")
    moves = [
        _move(recording, decay) for recording, own in zip(recordings, decays, strict=True) for decay in own
    ]
    if not moves:
        raise ContidError("body: no ring-down; `contid excite --part ring-downs` makes some")
    fitted = moves[0::2]
    kept = moves[1::2] or moves
    start = np.array([0.0, math.log(max(robot.dynamics.damping_ms, 0.1) * 1e-3), 0.02])
    low, high = np.array([-3.0, math.log(1e-5), 0.0]), np.array([3.0, 0.0, 0.5])

    def left(parameters: Array, of: Sequence[_Move]) -> Array:
        return np.concatenate([_left(robot, parameters, move) for move in of])

    blocks = _blocks(fitted)
    # A first look at masses: far from the truth the swings run out of step, and least squares stops early.
    tries = [np.array([math.log(mass), start[1], start[2]]) for mass in (0.5, 0.7, 1.0, 1.4, 2.0)]
    start_at = min(tries, key=lambda p: float((left(p, fitted) ** 2).sum()))
    found = estimate(lambda p: left(p, fitted), start_at, low, high, blocks)
    log_mass, log_damping, _ = found.values.tolist()
    for value, prior, name in (
        (log_mass, _PRIOR[0], "mass"),
        (log_damping - start[1], _PRIOR[1], "damping"),
    ):
        if abs(value) > _ACCEPTED * prior:
            raise ContidError(
                f"body: {name} would be {math.exp(value):.2g} times that of the file, which is refused; "
                "correct the file, or the lengths and stiffness it has, first"
            )
    stages = []
    for name, parameters in (("body of the file", start), ("fitted body", found.values)):
        errors = [error_of(left(parameters, of), _blocks(of)) for of in (fitted, kept)]
        stages.append(JudgedStage(name, *errors))
    return BodyFit(
        found.interval(1.0).exponential(),
        found.interval(0.0, 1.0).exponential(),
        found.interval(0.0, 0.0, 1.0),
        tuple(stages),
        (len(fitted), len(moves) - len(fitted)),
    )


def scaled(dynamics: Dynamics, mass: float, damping_s: float) -> Dynamics:
    """A body with other mass and damping."""
    per_m = dynamics.mass_g_per_m
    if per_m is None:
        raise ContidError("body: give dynamics.mass_g_per_m; the weight of the statics is not changed here")
    return dynamics.model_copy(
        update={
            "mass_g_per_m": tuple(mass * each for each in per_m),
            "tip_mass_g": mass * dynamics.tip_mass_g,
            "damping_ms": 1e3 * damping_s,
        }
    )


def _left(robot: Cosserat | TendonRobot, parameters: Array, move: _Move) -> Array:
    mass, damping_s = np.exp(parameters[:2]).tolist()
    assert robot.dynamics is not None
    arm = MovingArm(robot.model_copy(update={"dynamics": scaled(robot.dynamics, mass, damping_s)}))
    places = np.arange(float(len(move.driven))) - float(parameters[2]) / _STEP_S
    driven = between(move.driven, places)
    arm.settle(driven[0].tolist())
    tips = []
    before = None
    for actuation in driven.tolist():
        if actuation != before:
            arm.command(actuation)
            before = actuation
        try:
            arm.rod.run(_STEP_S, _STEP_S)
        except ArithmeticError:
            return np.full_like(move.tip_m, 1.0)  # a body that breaks down is no answer
        tips.append(arm.tip_m)
    # The first tip is that behind the first step.
    gap = move.tip_m - between(np.array(tips), move.at_s / _STEP_S - 1.0)
    return np.asarray(gap - gap.mean(axis=0))


def _move(recording: RobotRecording, decay: Decay) -> _Move:
    begin_s = max(decay.start_s - _BEFORE_S, 0.0)
    end_s = min(decay.start_s + _DECAY_S, recording.duration_s)
    grid = np.arange(begin_s, end_s, _STEP_S)
    count = len(recording.robot.axis_names)
    ticks = np.arange(float(len(recording.sent))) * recording.period_s
    driven = []
    for k in range(count):
        at_s, values = recording.axis_at_s[k], recording.axis_measured[k]
        if len(at_s) < 2:
            at_s, values = ticks, recording.sent[:, k]
        driven.append(np.interp(grid, at_s, _smoothed(values)))
    rows = (recording.tip_at_s >= begin_s) & (recording.tip_at_s < end_s)
    return _Move(np.column_stack(driven), recording.tip_at_s[rows] - begin_s, recording.tip_m[rows])


def _smoothed(values: Array) -> Array:
    """Means of five: the noise of a gauge is no motion."""
    if len(values) < 5:
        return values
    return np.asarray(np.convolve(np.pad(values, 2, mode="edge"), np.full(5, 0.2), mode="valid"))


def _blocks(moves: Sequence[_Move]) -> Array:
    return decay_blocks([len(each.at_s) for each in moves])
