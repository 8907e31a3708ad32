"""A trajectory of a robot file as commands that lead it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from contid.errors import ContidError
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import build_model
from contid_dynamics.coordinates import Pressures, coordinates_of, held
from contid_dynamics.lead import Answer, answer_of, answered, check_velocities, eased, led
from contid_dynamics.smoothed import smoothed, tips_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from contid.kinematics.array import Array
    from contid.kinematics.model import Model
    from contid.robot_file.load import LoadedFile
    from contid.robot_file.robot import RobotDescription
    from contid.trajectory.timed import Trajectory

#: Greatest residual of the model at a row [m].
_RESIDUAL_M: Final = 1e-4
#: A path that is not at rest sets out within a period of the first mode and this many lags, at least [s].
_LAGS: Final = 2.0
_LEAST_EASE_S: Final = 0.5
#: Tips are compared this often [s].
_LOOK_S: Final = 0.02
#: Numbers of a tip; more axes leave some of them free.
_TIP: Final = 3


class TipError(NamedTuple):
    """How far the tip is from the path by the model, at the delay that is printed [m]."""

    rms_m: float
    worst_m: float


@dataclass(frozen=True)
class LedFile:
    """The commands as text.

    Attributes:
        text: CSV with the axes of the model.
        rows: how many.
        later_s: by how much the robot does the path later.
        ease_s: how long it sets out and stops, where the path is not at rest.
        held: at how many of the rows a limit acts.
        plain, ahead: how far the tip is from the path with the path as commands, and with these.
    """

    text: str
    rows: int
    later_s: float
    ease_s: float
    held: int
    plain: TipError
    ahead: TipError


@dataclass(frozen=True)
class LedCommands:
    """Commands that lead a path, and the path at their times.

    Attributes:
        path: actuations ``(rows, axes)``, without the dead time.
        commands: actuations ``(ticks, axes)``.
        held: at how many of them a limit acts.
        answer: of the robot.
    """

    path: Array
    commands: Array
    held: int
    answer: Answer


def led_file(
    loaded: LoadedFile, trajectory: Trajectory, body: bool = True, ease_s: float | None = None
) -> LedFile:
    """Commands at the rate of the file.

    Args:
        loaded: with one robot, which has ``dynamics``.
        trajectory: its path.
        body: also for the first mode, at the mean of the path.
        ease_s: how long a path that is not at rest sets out and stops; chosen by the answer by default.

    Raises:
        ContidError: the robot has no ``dynamics`` or extra axes, a row is out of reach, the axes are too
            slow, or the limits leave nothing of the lead.
    """
    ((name, robot),) = loaded.driven.items()
    if robot.extra_axis_names:
        raise ContidError(f"{name}: a lead is for the axes of the model; it has extra ones as well")
    model, frame = build_model(robot), BaseFrame.of(robot.base)
    period_s = 1.0 / loaded.file.rate_hz
    times_s = np.array([trajectory.time_of_row(row) for row in range(len(trajectory))])
    seed, rows, by_tips = robot.rest, [], True
    for at_s in times_s.tolist():
        target = trajectory.targets_at(at_s)[name]
        found = model.inverse(frame.target_in_base(target), seed)
        if found.residual_m > _RESIDUAL_M:
            raise ContidError(f"{name}: the path is out of reach at {at_s:.3f} s; contid check shows where")
        seed, by_tips = found.actuation, by_tips and target.tip_m is not None
        rows.append(seed)
    path = np.array(rows)
    answer = answer_of(robot, path.mean(axis=0).tolist(), body)
    if ease_s is None:
        ease_s = max(_LEAST_EASE_S, 1.0 / answer.frequency_hz + _LAGS * max(answer.lag_s))
    made = led_commands(
        robot, model, path, times_s - times_s[0], period_s, answer, ease_s=ease_s, by_tips=by_tips
    )
    check_velocities(robot, name, made.commands, period_s)
    plain, ahead = (_tip_error(model, made, each, period_s) for each in (made.path, made.commands))
    if ahead.rms_m >= plain.rms_m > _RESIDUAL_M:
        raise ContidError(
            f"{name}: the limits leave nothing of the lead: the tip would be {1e3 * ahead.rms_m:.2g} mm from "
            f"the path, and {1e3 * plain.rms_m:.2g} mm without; keep the path off them, or make it slower"
        )
    commands = robot.quantity.from_si(made.commands)
    eases = len(made.path) * period_s > float(times_s[-1] - times_s[0]) + 1.5 * period_s
    return LedFile(
        rows_text(("t_s", *robot.columns), commands, period_s), len(commands), max(answer.delay_s),
        ease_s if eases else 0.0, made.held, plain, ahead,
    )  # fmt: skip


def rows_text(columns: Sequence[str], commands: Array, period_s: float, first_tick: int = 0) -> str:
    """Commands ``(ticks, axes)`` as CSV, one per tick from ``first_tick`` on."""
    lines = [",".join(columns)]
    lines += [
        f"{tick * period_s:.12g}," + ",".join(f"{value:.9g}" for value in row)
        for tick, row in enumerate(commands.tolist(), first_tick)
    ]
    return "\n".join(lines) + "\n"


def led_commands(
    robot: RobotDescription,
    model: Model,
    path: Array,
    times_s: Array,
    period_s: float,
    answer: Answer,
    *,
    ease_s: float,
    by_tips: bool = False,
) -> LedCommands:
    """Commands for a path of actuations, within the limits of their values.

    Args:
        robot: description of the robot.
        model: of it.
        path: actuations ``(rows, axes)`` [m or Pa].
        times_s: of the rows, from 0 on.
        period_s: between two commands.
        answer: of the robot.
        ease_s: see `eased`.
        by_tips: only the tip counts: axes that it leaves free may move as they are best led.
    """
    coordinates = coordinates_of(robot, model, period_s)
    if by_tips and isinstance(coordinates, Pressures) and path.shape[1] > _TIP:
        tips = eased(tips_of(model, path), times_s, period_s, ease_s)
        of_path = smoothed(model, tips, period_s, answer, path[0], max(1, round(_LOOK_S / period_s)))
    else:
        of_path = eased(coordinates.of(path), times_s, period_s, ease_s)
    found = held(coordinates, of_path, led(of_path, period_s, _shared(answer, of_path.shape[1])))
    return LedCommands(
        coordinates.actuations(of_path), coordinates.actuations(found.rows), found.ticks, answer
    )


def _shared(answer: Answer, count: int) -> Answer:
    """The answer of as many coordinates: bends, which all tendons share, have the mean of their lags."""
    if count == len(answer.delay_s):
        return answer
    lag_s = sum(answer.lag_s) / len(answer.lag_s)
    return replace(answer, delay_s=(max(answer.delay_s),) * count, lag_s=(lag_s,) * count)


def _tip_error(model: Model, made: LedCommands, commands: Array, period_s: float) -> TipError:
    delays = made.answer.delay_s
    late = math.ceil((max(delays) - min(delays)) / period_s - 1e-9)
    follows = np.vstack((commands, np.repeat(commands[-1:], len(made.path) + late, axis=0)))
    reached = answered(follows, period_s, made.answer)[late:]
    every = max(1, round(_LOOK_S / period_s))
    tips, wished = (tips_of(model, rows[: len(made.path) : every]) for rows in (reached, made.path))
    apart = np.linalg.norm(tips - wished, axis=1)
    return TipError(float(np.sqrt(np.mean(apart**2))), float(apart.max()))
