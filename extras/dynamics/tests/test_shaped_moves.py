"""Moves shaped over poses: the swing that is left on a plant apart from the model of the schedule.

The plant weighs more or less than the file states, so that its frequencies are wrong by a fifth, or carries
a mass that its targets do or do not state. Moves are those of the approach of the tick, commands of
200 Hz, on the moving rod. Baselines in the same table: no shaping, one frequency for all poses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from contid.control.tick.shaping import NOT_SHAPED, ShaperChoice, next_shaped
from contid.kinematics.array import Array
from contid.kinematics.model import Bending, build_model
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_named
from contid.robot_file.rates import InputShape, ShapeKind
from contid.robot_file.tendon.robot import TendonRobot
from contid.trajectory.approach import Approach
from contid.units import STANDARD_GRAVITY
from contid_dynamics.arm import MovingArm
from contid_dynamics.schedule import random_actuations, schedule_of

TICK_S = 0.005
#: How long the tip is watched after the last command.
WATCHED_S = 1.0


@dataclass(frozen=True)
class Plant:
    """A robot that moves, and where it goes."""

    arm: MovingArm
    starts: Array
    goals: Array


def robot_of(name: str, mass: float = 1.0) -> Cosserat | TendonRobot:
    """A shipped robot whose body weighs as many times as much; pneumatic ones hang."""
    (robot,) = load_named(name).driven.values()
    assert isinstance(robot, (Cosserat, TendonRobot))
    assert robot.dynamics is not None
    assert robot.dynamics.mass_g_per_m is not None
    masses = tuple(mass * each for each in robot.dynamics.mass_g_per_m)
    return robot.model_copy(
        update={
            "down": (0.0, 0.0, -1.0 if isinstance(robot, TendonRobot) else 1.0),
            "dynamics": robot.dynamics.model_copy(update={"mass_g_per_m": masses}),
        }
    )


@cache
def shape_of(name: str, load_g: float, poses: int) -> InputShape:
    return InputShape.model_validate(schedule_of(robot_of(name), poses, load_g).shape)


def plant(
    name: str,
    moves: int,
    frequency: float = 1.0,
    payload_g: float = 0.0,
    share: float = 1.0,
    s_poses: bool = False,
) -> Plant:
    """A plant with frequencies as many times those of the model, and random moves in a share of its reach.

    S poses of a tendon robot have a middle section that bends the other way than its neighbours.
    """
    robot = robot_of(name)
    arm = MovingArm(robot_of(name, frequency**-2), payload_g * 1e-3)
    actuations = random_actuations(robot, (120 if s_poses else 2) * moves, seed=11, share=share)
    if s_poses:
        model = build_model(robot)
        assert isinstance(model, Bending)
        kept = [row for row in actuations if _is_s(model.arcs(tuple(row.tolist())))]
        actuations = np.array(kept[: 2 * moves])
        assert len(actuations) == 2 * moves
    return Plant(arm, actuations[:moves], actuations[moves:])


def _is_s(arcs: Array) -> bool:
    bends = arcs[:, :2]
    size = np.linalg.norm(bends, axis=1)
    turned = [float(a @ b / (p * q)) for a, b, p, q in zip(bends, bends[1:], size, size[1:], strict=False)]
    return min(size) > math.radians(20.0) and max(turned) < -0.5


def commands(
    name: str, start: Array, goal: Array, shape: InputShape | None, payload_g: float
) -> Iterator[Sequence[float]]:
    """What goes to the devices, until it stands."""
    robot = robot_of(name)
    begin, end = tuple(start.tolist()), tuple(goal.tolist())
    straight = isinstance(robot, TendonRobot)
    way = Approach(begin, [0.0] * len(begin), end, *robot.rate_limits, straight=straight)
    shaper = None if shape is None else ShaperChoice.of(shape, robot.quantity, TICK_S).shaper
    state, last = NOT_SHAPED, begin
    for tick in range(1, 2 + math.ceil(way.duration_s / TICK_S) + round(3.0 / TICK_S)):
        command = way.at(tick * TICK_S)[0]
        if shaper is None:
            yield command
        else:
            force = (0.0, 0.0, -1e-3 * payload_g * STANDARD_GRAVITY)
            state = next_shaped(shaper, state, last, command, end, force)
            yield state.acting
        last = command
        if tick * TICK_S > way.duration_s and state.ticks_left == 0:
            return


def swing_mm(of: Plant, name: str, move: int, shape: InputShape | None, payload_g: float = 0.0) -> float:
    """Greatest distance of the tip from its rest after the last command; NaN where the model has no answer.

    Args:
        of: plant and moves.
        name: of the robot.
        move: number of the move.
        shape: of its commands.
        payload_g: what the targets state.
    """
    step_s = TICK_S / (5 if isinstance(of.arm.robot, TendonRobot) else 2)
    try:
        of.arm.settle(of.goals[move].tolist(), steps=16)
        rest = of.arm.tip_m
        of.arm.settle(of.starts[move].tolist(), steps=16)
        for row in commands(name, of.starts[move], of.goals[move], shape, payload_g):
            of.arm.command(row, within_s=TICK_S)
            of.arm.rod.run(TICK_S, step_s)
        every = round(TICK_S / step_s)
        tips = of.arm.tips_of(of.arm.rod.run(WATCHED_S, step_s, every=every)[:, 0])
    except ArithmeticError:
        return math.nan
    return float(1e3 * np.linalg.norm(tips - rest, axis=1).max())


@dataclass(frozen=True)
class Left:
    """Swings over moves [mm] with one way of shaping."""

    median: float
    p95: float


def left(of: Plant, name: str, shapes: Sequence[InputShape | None], payload_g: float = 0.0) -> list[Left]:
    """Of each way of shaping, over the moves that the plant has an answer to in every one."""
    rows = [[swing_mm(of, name, k, shape, payload_g) for shape in shapes] for k in range(len(of.goals))]
    known = np.array([row for row in rows if all(map(math.isfinite, row))])
    assert len(known) > len(rows) / 2
    return [Left(float(np.median(each)), float(np.percentile(each, 95))) for each in known.T]


def one_frequency(shape: InputShape) -> InputShape:
    """That of the robot at rest, for all poses."""
    return shape.model_copy(update={"schedule": None})


def ways(name: str, load_g: float, poses: int) -> list[InputShape | None]:
    """No shaping, zv and zvd at one frequency, and the schedule."""
    shape = shape_of(name, load_g, poses)
    fixed = one_frequency(shape)
    return [None, fixed.model_copy(update={"kind": ShapeKind.ZV}), fixed, shape]


def test_a_schedule_leaves_a_twelfth_of_the_swing_where_one_frequency_leaves_more() -> None:
    name = "stiffflop2"
    shape = shape_of(name, 0.0, 60)
    found = left(plant(name, 3, share=0.6), name, (None, one_frequency(shape), shape))
    free, fixed, scheduled = (each.median for each in found)
    assert free > 10.0
    assert fixed > 0.12 * free
    assert scheduled < 0.08 * free


@pytest.mark.campaign
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "share", "load_g", "poses"),
    [("stiffflop2", 1.0, 10.0, 200), ("tendon3", 0.5, 5.0, 400), ("tendon3, S", 0.5, 5.0, 400)],
)
@pytest.mark.parametrize(
    ("frequency", "loaded", "stated", "most"),
    [(1.0, 0, 0, 0.10), (0.8, 0, 0, 0.25), (1.2, 0, 0, 0.25), (1.0, 1, 0, 0.35), (1.0, 1, 1, 0.16)],
)
def test_the_swing_left_over_200_moves(
    name: str,
    share: float,
    load_g: float,
    poses: int,
    frequency: float,
    loaded: int,
    stated: int,
    most: float,
) -> None:
    """On plants with as many times the frequency, and with a load that targets state or not."""
    robot, _, poses_of = name.partition(", ")
    of = plant(robot, 200, frequency, loaded * load_g, share, s_poses=bool(poses_of))
    found = left(of, robot, ways(robot, load_g, poses), stated * load_g)
    for what, each in zip(("none", "zv", "zvd", "schedule"), found, strict=True):
        print(f"{name}, {frequency:g}, {loaded * load_g:g} g: {what} {each.median:.2f} ({each.p95:.2f}) mm")
    free, _, zvd, scheduled = (each.median for each in found)
    assert scheduled <= most * free
    assert scheduled <= zvd
