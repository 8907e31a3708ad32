"""Tensions in motion beside a chain written apart: rigid links in a plane, absolute angles, an ODE of scipy.

The chain shares no code with the moving rod: links and hinges instead of elements of constant strain, the
closed equations of a planar multiple pendulum instead of a variational integrator, tendons as springs with
dampers along it. It gets what goes to the devices, linear between two commands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from contid.control.tick.shaping import NOT_SHAPED, ShaperChoice, next_shaped
from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.model import build_model
from contid.robot_file.load import load_named, parse_robot_file
from contid.robot_file.rates import InputShape
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import Target
from contid.trajectory.approach import Approach
from contid.units import DEG
from contid_dynamics.arm import MovingArm
from contid_dynamics.tension_swing import tension_swing

TICK_S = 0.005
#: How long the swing after the last command is watched.
WATCHED_S = 0.2
HINGES = 4
SHAPE = InputShape(frequency_hz=7.4, damping_ratio=0.07)
#: Bends of the three sections at begin and goal [deg], all in one plane.
MOVES = (((0, 0, 0), (50, 50, 50)), ((-70, -60, 10), (30, 70, 60)))
#: Least tensions of the chain [N], 3 to 6 s of a processor each; `pytest -m campaign` on this file computes
#: them. With a room of 2 N, of both moves; then a room with which neither falls below the floor.
CHAIN_LEAST_N = (2.451094, 2.751891)
CHAIN_ROOM_N = 0.6


@dataclass(frozen=True)
class Planar:
    """A tendon robot in a plane: hinges, each in the middle of a piece of the backbone, and rigid links.

    Attributes:
        begin: angles of the links at rest [rad].
        pulls_m: of the tendons at the ticks.
        straight_n: tension of the straight robot.
    """

    robot: TendonRobot
    begin: Array
    pulls_m: Array
    straight_n: float

    def least_n(self) -> float:
        """The least tension of all tendons from the first command on."""
        from scipy.integrate import solve_ivp

        assert self.robot.tension is not None
        assert self.robot.dynamics is not None
        assert self.robot.dynamics.mass_g_per_m is not None
        sections = self.robot.geometry.sections
        piece = np.repeat([1e-3 * each.length_mm / HINGES for each in sections], HINGES)
        count = len(piece)
        # The link behind hinge i ends at the next hinge; the last one at the tip.
        link = np.append(0.5 * (piece[:-1] + piece[1:]), 0.5 * piece[-1])
        mass = 1e-3 * self.robot.dynamics.mass_g_per_m[0] * link
        radius = 1e-3 * sections[0].radius_mm[0]
        ways = np.tril(np.broadcast_to(link, (count, count)), -1) + np.diag(0.5 * link)
        coupling = ways.T @ (mass[:, None] * ways)
        turning = np.diag(mass * (link**2 / 12.0 + radius**2 / 4.0))
        bending = 1e-6 * self.robot.tension.bending_n_mm2[0] / piece
        stiff = 1e3 * self.robot.tension.tendon_n_per_mm[0]
        damping_s = 1e-3 * self.robot.dynamics.damping_ms
        arms = np.array(
            [
                [
                    radius * math.cos(angle * DEG) if hinge < (k + 1) * HINGES else 0.0
                    for hinge in range(count)
                ]
                for k, section in enumerate(sections)
                for angle in section.angles_deg
            ]
        )
        ticks = np.arange(len(self.pulls_m))
        slopes = np.vstack((np.diff(self.pulls_m, axis=0) / TICK_S, np.zeros(self.pulls_m.shape[1])))

        def tensions(time_s: float, hinges: Array, rates: Array) -> Array:
            at = min(int(time_s / TICK_S), len(ticks) - 1)
            pull = self.pulls_m[at] + (time_s - at * TICK_S) * slopes[at]
            spring = np.maximum(0.0, self.straight_n + stiff * (pull - arms @ hinges))
            damper = damping_s * stiff * (slopes[at] - arms @ rates)
            return np.asarray(spring + np.clip(damper, -spring, spring))

        def derivative(time_s: float, state: Array) -> Array:
            angles, rates = state[:count], state[count:]
            hinges, hinge_rates = np.diff(angles, prepend=0.0), np.diff(rates, prepend=0.0)
            moments = arms.T @ tensions(time_s, hinges, hinge_rates)
            moments -= bending * (hinges + damping_s * hinge_rates)
            apart = angles[:, None] - angles
            forces = moments - np.append(moments[1:], 0.0) - (coupling * np.sin(apart)) @ rates**2
            return np.concatenate((rates, np.linalg.solve(coupling * np.cos(apart) + turning, forces)))

        end_s = TICK_S * (len(ticks) - 1)
        state = np.concatenate((self.begin, np.zeros(count)))
        found = solve_ivp(
            derivative, (0.0, end_s), state, method="BDF", rtol=1e-5, atol=1e-7, max_step=TICK_S,
            t_eval=np.arange(0.5, 1e3 * end_s) * 1e-3,
        )  # fmt: skip
        assert found.success
        pairs = zip(found.t, found.y.T, strict=True)
        return min(
            float(tensions(t, np.diff(y[:count], prepend=0.0), np.diff(y[count:], prepend=0.0)).min())
            for t, y in pairs
        )


def robot_with(swing_n: float) -> TendonRobot:
    (robot,) = load_named("tendon3").driven.values()
    assert isinstance(robot, TendonRobot)
    assert robot.tension is not None
    return robot.model_copy(update={"tension": robot.tension.model_copy(update={"swing_n": swing_n})})


def commanded(robot: TendonRobot, move: int, shape: InputShape | None) -> tuple[Array, Array]:
    """Bends of the begin [rad], and pulls at the ticks until the swing has died out."""
    model = build_model(robot)
    begin, goal = (
        model.inverse(Target(arcs=tuple(x for bend in bends for x in (bend * DEG, 0.0, 0.0))), robot.rest)
        for bends in MOVES[move]
    )
    assert begin.converged
    assert goal.converged
    start, end = begin.actuation, goal.actuation
    way = Approach(start, [0.0] * len(start), end, *robot.rate_limits, straight=True)
    choose = None if shape is None else ShaperChoice.of(shape, robot.quantity, TICK_S).shaper
    state, last, rows = NOT_SHAPED, start, [start]
    for tick in range(1, math.ceil((way.duration_s + 0.3) / TICK_S)):
        command = way.at(tick * TICK_S)[0]
        if choose is None:
            rows.append(command)
        else:
            state = next_shaped(choose, state, last, command, end)
            rows.append(state.acting)
        last = command
    rows += [rows[-1]] * round(WATCHED_S / TICK_S)
    return np.array(MOVES[move][0]) * DEG, np.array(rows)


def chain_least_n(robot: TendonRobot, move: int, shape: InputShape | None) -> float:
    assert robot.tension is not None
    bends, pulls = commanded(robot, move, shape)
    begin = np.cumsum(np.repeat(bends / HINGES, HINGES))
    return Planar(robot, begin, pulls, robot.tension.floor_n + robot.tension.swing_n).least_n()


def rod_least_n(robot: TendonRobot, move: int, shape: InputShape | None) -> float:
    arm = MovingArm(robot, elements=HINGES)
    _, pulls = commanded(robot, move, shape)
    arm.settle(pulls[0].tolist())
    least = math.inf
    for row in pulls[1:]:
        arm.command(row.tolist(), within_s=TICK_S)
        for _ in range(5):
            arm.rod.run(1e-3, 1e-3)
            least = min(least, float(arm.rod.tensions_n.min()))
    return least


@pytest.mark.parametrize(("move", "shape"), [(0, None), (1, SHAPE)])
def test_the_rod_has_the_tensions_of_a_chain_of_hinges(move: int, shape: InputShape | None) -> None:
    assert rod_least_n(robot_with(2.0), move, shape) == pytest.approx(CHAIN_LEAST_N[move], abs=0.01)


@pytest.mark.campaign
@pytest.mark.parametrize(("move", "shape"), [(0, None), (1, SHAPE)])
def test_the_chain_has_the_tensions_above(move: int, shape: InputShape | None) -> None:
    assert chain_least_n(robot_with(2.0), move, shape) == pytest.approx(CHAIN_LEAST_N[move], abs=1e-3)


@pytest.mark.campaign
@pytest.mark.parametrize("move", [0, 1])
def test_the_chain_needs_that_room(move: int) -> None:
    robot = robot_with(0.0)
    assert robot.tension is not None
    assert chain_least_n(robot, move, SHAPE) < robot.tension.floor_n
    assert chain_least_n(robot_with(CHAIN_ROOM_N), move, SHAPE) >= robot.tension.floor_n


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tries", "least_n"), [(8, 0.5), pytest.param(40, CHAIN_ROOM_N, marks=pytest.mark.campaign)]
)
def test_the_room_for_the_swing_is_what_the_chain_needs(
    tries: int, least_n: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A short search comes within a tenth of a newton; that of the command finds all of it."""
    monkeypatch.setattr("contid_dynamics.tension_swing._TRIES", tries)
    found = tension_swing(robot_with(0.0), SHAPE, moves=12)
    assert found.without == 0
    assert least_n <= found.swing_n < CHAIN_ROOM_N + 0.2


def test_limits_without_room_for_the_swing_are_refused() -> None:
    robot = robot_with(0.0)
    assert robot.tension is not None
    close = robot.model_copy(update={"tension": robot.tension.model_copy(update={"max_n": 3.9})})
    with pytest.raises(ContidError, match=r"max_n 3.9 leaves no room"):
        tension_swing(close, SHAPE, moves=4)


def test_commands_keep_the_floor_and_the_swing() -> None:
    text = load_named("tendon3").text
    loaded = parse_robot_file(text.replace("floor_n: 1.0", "floor_n: 1.0\n      swing_n: 0.6"), "arm.yaml")
    (robot,) = loaded.driven.values()
    model = build_model(robot)
    answer = model.inverse(Target(arcs=(0.5, 0.2, 0.0, -0.3, 0.4, 0.0, 0.2, 0.2, 0.0)), robot.rest)
    tensions = model.tensions(answer.actuation)  # type: ignore[attr-defined]
    assert tensions.reshape(3, 3).min(axis=1) == pytest.approx([1.6] * 3, abs=1e-9)
    with pytest.raises(ContidError, match=r"max_n 25 is less than twice floor_n plus swing_n, 26"):
        parse_robot_file(text.replace("floor_n: 1.0", "floor_n: 1.0\n      swing_n: 12"), "arm.yaml")
