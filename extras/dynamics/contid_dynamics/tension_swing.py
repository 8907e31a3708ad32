"""How far the tensions of a tendon robot fall below those of its commands while its body moves.

Commands keep the floor of tension by the statics. In motion a tendon also accelerates the body and bears its
swings, so that the slackest one falls below. As long as all of them pull, by how much does not depend on how
tight they are: tension that does not bend moves nothing. So the floor of the commands is raised by the most
that is found, ``tension.swing_n``, until no tendon falls below the floor of the file.

Moves go at full rates between random poses, shaped as the file will have it; from the moves that fall the
most the search climbs on, with begins and goals nearby.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.control.tick.shaping import NOT_SHAPED, ShaperChoice, next_shaped
from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.model import Bending, build_model
from contid.robot_file.rates import InputShape
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import Actuation, Target
from contid.trajectory.approach import Approach
from contid.units import STANDARD_GRAVITY
from contid_dynamics.arm import MovingArm
from contid_dynamics.schedule import random_actuations

#: Between two commands, and the steps of the body in it [s].
_TICK_S: Final = 5e-3
_STEP_S: Final = 1e-3
#: How long the swing after the last command counts, in periods of the slowest mode: it only dies out.
_PERIODS: Final = 1.5
#: From how many of the worst moves the search climbs, in how many tries each, and how far [rad].
_CLIMBS: Final = 3
_TRIES: Final = 40
_NEARBY_RAD: Final = 0.25
#: After a fall beyond the room that the commands had, the next room is as many times the fall.
_AGAIN: Final = 1.5
#: What is written is rounded up to a multiple of this [N].
_ROUNDED_N: Final = 0.05


@dataclass(frozen=True)
class TensionSwing:
    """What was found.

    Attributes:
        swing_n: value of ``tension.swing_n``.
        greatest_n: greatest fall of all moves.
        median_n: of the random ones.
        moves: how many random moves the body has an answer to.
        without: to how many it has none.
    """

    swing_n: float
    greatest_n: float
    median_n: float
    moves: int
    without: int


def tension_swing(
    robot: TendonRobot, shape: InputShape | None, moves: int, load_g: float = 0.0, seed: int = 2
) -> TensionSwing:
    """Find ``tension.swing_n`` of a robot.

    Args:
        robot: with ``dynamics`` and ``tension``.
        shape: of its commands; None for none.
        moves: how many random moves.
        load_g: greatest mass on the tip, besides that of ``dynamics``; moves are done with it and without.
        seed: of the moves.

    Raises:
        ContidError: ``tension.max_n`` leaves no room for it, or the model has no answer to most moves.
    """
    assert robot.tension is not None
    reserve_n = robot.tension.floor_n
    while True:
        if 2.0 * (robot.tension.floor_n + reserve_n) > robot.tension.max_n:
            raise ContidError(
                f"tension: max_n {robot.tension.max_n:g} leaves no room: tensions in motion are searched "
                f"with commands that keep {robot.tension.floor_n + reserve_n:.3g} N; lower rates or floor_n"
            )
        found = [_Moves(robot, shape, reserve_n, mass_g) for mass_g in dict.fromkeys((0.0, load_g))]
        falls = np.array([each.random(moves, seed) for each in found])
        greatest_n = max(each.climbed(seed) for each in found)
        if greatest_n <= reserve_n:
            break
        reserve_n = _AGAIN * greatest_n
    known = falls[np.isfinite(falls)]
    return TensionSwing(
        round(_ROUNDED_N * math.ceil(greatest_n / _ROUNDED_N), 6),
        greatest_n,
        float(np.median(known)),
        len(known),
        falls.size - len(known),
    )


class _Moves:
    """Moves of a robot whose commands keep a floor by so much above that of its file."""

    def __init__(self, robot: TendonRobot, shape: InputShape | None, reserve_n: float, load_g: float) -> None:
        assert robot.tension is not None
        raised = robot.tension.model_copy(update={"swing_n": reserve_n})
        self._robot = robot.model_copy(update={"tension": raised})
        self._floor_n = raised.commanded_floor_n
        self._load_n = (0.0, 0.0, -1e-3 * load_g * STANDARD_GRAVITY)
        # Where the statics of the file know no load, tensions differ by it at rest too: that counts.
        self._arm = MovingArm(self._robot, 1e-3 * load_g)
        model = build_model(self._robot.model_copy(update={"residual": None, "friction": None, "rod": None}))
        assert isinstance(model, Bending)
        self._model = model
        self._choose = None if shape is None else ShaperChoice.of(shape, robot.quantity, _TICK_S).shaper
        self._worst: list[tuple[float, Actuation, Actuation]] = []

    def random(self, moves: int, seed: int) -> list[float]:
        """How far tensions fall in random moves [N]; NaN without an answer.

        Raises:
            ContidError: most have none.
        """
        poses = [tuple(row) for row in random_actuations(self._robot, 2 * moves, seed).tolist()]
        pairs = list(zip(poses[:moves], poses[moves:], strict=True))
        falls = [self._fall(*pair) for pair in pairs]
        known = [(fall, *pair) for fall, pair in zip(falls, pairs, strict=True) if math.isfinite(fall)]
        if 2 * len(known) < moves:
            raise ContidError(
                f"the body in motion has an answer to {len(known)} of {moves} random moves only"
            )
        self._worst = sorted(known, reverse=True)[:_CLIMBS]
        return falls

    def climbed(self, seed: int) -> float:
        """The most that a search near the worst of them finds [N]."""
        rng = np.random.default_rng(seed)
        greatest = 0.0
        for fall, start, goal in self._worst:
            for _ in range(_TRIES):
                near = self._nearby(start, rng), self._nearby(goal, rng)
                other = self._fall(*near)
                if other > fall:
                    fall, (start, goal) = other, near
            greatest = max(greatest, fall)
        return greatest

    def _nearby(self, pose: Actuation, rng: np.random.Generator) -> Actuation:
        arcs: Array = self._model.arcs(pose)
        arcs[:, :2] += rng.normal(0.0, _NEARBY_RAD, arcs[:, :2].shape)
        arcs[:, 2] = 0.0
        return self._model.inverse(Target(arcs=tuple(arcs.ravel().tolist())), pose).actuation

    def _fall(self, start: Actuation, goal: Actuation) -> float:
        arm, least = self._arm, math.inf
        try:
            arm.settle(start, steps=16)
            for row in self._commands(start, goal):
                arm.command(row, within_s=_TICK_S)
                arm.rod.run(_TICK_S, _STEP_S)
                least = min(least, float(arm.rod.tensions_n.min()))
        except ArithmeticError:
            return math.nan
        return self._floor_n - least

    def _commands(self, start: Actuation, goal: Actuation) -> Iterator[Actuation]:
        """What goes to the devices, until the swing after it has passed its first turns."""
        way = Approach(start, [0.0] * len(start), goal, *self._robot.rate_limits, straight=True)
        state, last, tick, rests = NOT_SHAPED, start, 0, math.inf
        while tick < rests:
            tick += 1
            command = way.at(tick * _TICK_S)[0]
            if self._choose is None:
                yield command
            else:
                state = next_shaped(self._choose, state, last, command, goal, self._load_n)
                yield state.acting
            last = command
            if rests == math.inf and tick * _TICK_S > way.duration_s and state.ticks_left == 0:
                rests = tick + _PERIODS * self._period_ticks(goal)

    def _period_ticks(self, goal: Actuation) -> float:
        return 1.0 / (_TICK_S * max(float(self._arm.rod.modes().frequency_hz[0]), 0.5))
