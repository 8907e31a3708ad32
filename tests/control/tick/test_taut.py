"""Tendon robots between targets: tensions stay inside their bounds in every command that is sent."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import TENSION
from contid.control.tick.robot_tick import TickResult, tick
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.control.tick.transitions import goto, hold
from contid.hal import Sample
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.base import StopPolicy
from contid.robot_file.load import parse_robot_file
from contid.targets import Target
from contid.trajectory.standstill import JerkLimitedStop

ROUNDING_N = 1e-4  # 5 nm of pull at 20 N/mm


def config_of(configs: Path, name: str, *changes: tuple[str, str]) -> RobotConfig:
    text = (configs / f"{name}.yaml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (config,) = build_robot_configs(parse_robot_file(text, f"{name}.yaml"), 100.0)
    return config


@dataclass
class Run:
    """A robot that holds at first, tick by tick; devices arrive at their commands at once."""

    config: RobotConfig
    state: RobotState
    ticks: int = 0

    @classmethod
    def of(cls, config: RobotConfig, mode: Mode = Mode.RUN) -> Run:
        here = config.rest
        still = (0.0,) * len(here)
        state = RobotState(
            mode=mode, enabled=True, arm_requested=True, follow=True, command=here, reference=here,
            increments=still, misses=(0,) * len(here),
        )  # fmt: skip
        return cls(config, state)

    def step(self, target: Target | None) -> TickResult:
        values = self.config.transmission.to_device(self.state.command)
        samples = tuple(Sample(value, 0.01 * self.ticks, True, 0.0) for value in values)
        self.ticks += 1
        out = tick(self.config, self.state, 0.01 * self.ticks, samples, target)
        self.check(out)
        self.state = out.state
        return out

    def check(self, out: TickResult) -> None:
        """Tensions and rates of one command, against the balance of the model and the limits of the file."""
        model = self.config.model
        assert isinstance(model, TendonModel)
        assert model.statics is not None
        command = np.array(out.state.command)
        # The balance of energy, solved here from the geometry and the numbers of the robot file.
        G, k = model.geometry.pull_matrix, np.diag(model.statics.tendon_n_per_m)
        K = np.diag(np.repeat(model.statics.bending_nm, 2))
        bends = np.linalg.solve(G.T @ k @ G + K, G.T @ k @ command)
        tensions = model.statics.rest_n + k @ (command - G @ bends)
        assert np.min(tensions) >= model.statics.floor_n - ROUNDING_N, self.ticks
        assert np.max(tensions) <= model.statics.limit_n + ROUNDING_N, self.ticks
        angles = np.hypot(bends[0::2], bends[1::2])
        assert np.all(angles <= np.array(model.feasible.bend_max_rad) + 1e-6)
        steps = command - np.array(self.state.command)
        limits = self.config.limits[0]
        assert np.abs(steps).max() <= limits.step * (1 + 1e-9)
        assert np.abs(steps - np.array(self.state.increments)).max() <= limits.change * (1 + 1e-6), self.ticks


def anywhere(config: RobotConfig, rng: np.random.Generator) -> Target:
    """A reachable tip, now and then with its direction, pulls of reachable bends, or a tip out of reach."""
    model = config.model
    assert isinstance(model, TendonModel)
    feasible = model.feasible
    bends = feasible.pulled(rng.uniform(feasible.low, feasible.high)) / np.repeat(
        feasible.sections.backbone_m, 2
    )
    assert model.statics is not None
    pulls = tuple(np.clip(model.statics.pulls(bends), model.lower, model.upper).tolist())
    pose, kind = model.forward(pulls), rng.integers(0, 4)
    if kind == 0:
        return Target(actuation=pulls)
    if kind == 1:
        x, y, z = rng.uniform(-0.4, 0.4, 3).tolist()
        return Target(tip_m=(x, y, abs(z)))
    return Target(tip_m=pose.tip_m, direction=pose.direction if kind == 2 else None)


def arrived(run: Run, target: Target) -> bool:
    """True once the robot stands on the model's own answer."""
    for _ in range(1000):
        out = run.step(target)
        if out.solution is not None and run.state.command == out.solution.actuation and not out.limits:
            return True
    return False


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        ("tendon3", 0),
        *(
            pytest.param(*each, marks=pytest.mark.campaign)
            for each in (("tendon3", 1), ("ftdcr_v4", 0), ("ftdcr_v4", 1))
        ),
    ],
)
def test_random_live_jumps_keep_every_tension(configs: Path, name: str, seed: int) -> None:
    config, rng = config_of(configs, name), np.random.default_rng(seed)
    run, coordinated = Run.of(config), 0
    for _ in range(8):
        target = anywhere(config, rng)
        for _ in range(int(rng.integers(1, 60))):
            coordinated += bool(any(flag & TENSION for flag in run.step(target).limits))
    assert coordinated > 40
    assert arrived(run, target)


OTHERS = {
    "three times as stiff": [("bending_n_mm2: [2945]", "bending_n_mm2: [9000]")],
    "four tendons": [
        (
            "radius_mm: [8], angles_deg: [0, 120, 240]",
            "radius_mm: [8, 8, 8, 8], angles_deg: [0, 80, 180, 270]",
        ),
        ("      s1.t3:", "      s1.t4: {bus: servos, id: 10, mm_per_rev: 62.83}\n      s1.t3:"),
        ("rest_mm: [0,", "rest_mm: [0, 0,"),
    ],
    "little tension": [("max_n: 25", "max_n: 4")],
    "little travel": [("[[-45, 45]]", "[[-9, 7]]")],
    "play": [("    rates:\n", "    friction: {play_mm: [0.3]}\n    rates:\n")],
    "sheaths": [("routing: through", "routing: independent")],
}


@pytest.mark.parametrize("other", OTHERS)
def test_jumps_and_orders_on_other_robots(configs: Path, other: str) -> None:
    """Also holds, single targets and continued runs, each from any motion; at the end it arrives."""
    config, rng = config_of(configs, "tendon3", *OTHERS[other]), np.random.default_rng(7)
    run = Run.of(config)
    for _ in range(10):
        target, order = anywhere(config, rng), rng.integers(0, 3)
        now_s = 0.01 * run.ticks
        if order == 0 and run.state.mode is not Mode.HOLD:
            run.state = hold(config, run.state, now_s)
        elif order == 1:
            run.state = goto(config, run.state, target, now_s)
        else:
            run.state = replace(run.state, follow=True)
        for _ in range(int(rng.integers(1, 80))):
            run.step(target)
    run.state = replace(run.state, follow=True, goto=None)
    assert arrived(run, target)


def test_the_way_to_a_first_target_is_straight(configs: Path) -> None:
    """No limit of tension acts on an approach: a straight line between two places inside stays inside."""
    config = config_of(configs, "tendon3")
    run = Run.of(config, Mode.HOLD)
    target = anywhere(config, np.random.default_rng(3))
    goal = np.array(config.model.inverse(target, config.rest).actuation)
    modes = set()
    for _ in range(400):
        out = run.step(target)
        modes.add(out.state.mode)
        assert not any(flag & TENSION for flag in out.limits)
        command = np.array(out.state.command)
        share = command @ goal / (goal @ goal)
        assert np.abs(command - share * goal).max() < 1e-9
        if out.state.mode is Mode.RUN:
            break
    assert {Mode.APPROACH, Mode.RUN} <= modes


def test_a_robot_that_is_armed_slack_gets_taut_without_a_jump(configs: Path) -> None:
    """What the spools hold when torque goes on may be slack; it never gets worse."""
    config = config_of(configs, "tendon3")
    model = config.model
    assert isinstance(model, TendonModel)
    assert model.statics is not None
    begin = np.random.default_rng(5).uniform(-1e-3, 1e-3, 9)
    still = (0.0,) * 9
    here = tuple(begin.tolist())
    state = RobotState(
        mode=Mode.RUN, enabled=True, arm_requested=True, follow=True, command=here, reference=here,
        increments=still, misses=(0,) * 9,
    )  # fmt: skip
    lows = [float(np.min(model.statics.tensions(begin)))]
    assert lows[0] < 0.0
    target = Target(tip_m=(0.02, 0.03, 0.29))
    for k in range(200):
        values = config.transmission.to_device(state.command)
        out = tick(config, state, 0.01 * k, tuple(Sample(v, 0.01 * k, True, 0.0) for v in values), target)
        state = out.state
        lows.append(float(np.min(model.statics.tensions(np.array(state.command)))))
    assert min(lows) == lows[0]
    assert lows[-1] >= model.statics.floor_n - ROUNDING_N
    assert out.solution is not None
    assert state.command == out.solution.actuation


@pytest.mark.parametrize("skipped", [1, 7])
def test_a_moving_target_is_caught_up_with_soon(configs: Path, skipped: int) -> None:
    """After ticks that a live target went on without the robot; tensions bind on the way."""
    run = Run.of(config_of(configs, "tendon3"))

    def target(tick: int) -> Target:
        turn = 0.0125 * tick  # 50 mm/s on a circle of 40 mm
        return Target(tip_m=(0.04 * np.cos(turn), 0.04 * np.sin(turn), 0.28))

    for number in range(400):
        run.step(target(number))
    errors_m = [run.step(target(400 + skipped + number)).tip_error_m for number in range(40)]
    assert max(errors_m[4 * skipped :]) < 2e-4
    assert max(errors_m[2 * skipped + 10 :]) < 1e-6


def test_a_robot_held_beside_a_slack_reference_stands_still(configs: Path) -> None:
    # Found by random gotos and stops: two commands that differ by rounding followed each other for ever, so
    # the stop never ended and no trajectory began.
    run = Run.of(config_of(configs, "tendon3"), Mode.STOPPING)
    bends = (0.007365582690924001, 0.0027344300736111674, -0.008922025003141654)
    end = (0.003008506099624875, -0.007008497083381695, 0.004912016926947929)
    command = (*bends, -0.003653010679102271, 0.0036217335080086246, 0.0010884248462476422, *end)
    reference = (*bends, -0.0036589337164751215, 0.003615810470635774, 0.0010825018088747916, *end)
    step = (0.0, 0.0, 0.0, *(-8.673617379884035e-19,) * 3, 0.0, 0.0, 0.0)
    run.state = replace(
        run.state, command=command, reference=reference, increments=step, policy=StopPolicy.HOLD
    )
    for _ in range(10):
        run.step(None)
    assert run.state.mode is Mode.OFF
    assert not any(run.state.increments)


def test_a_stop_whose_end_is_out_of_bounds_ends_before_it(configs: Path) -> None:
    # Found in the same way: at the bound of a tension the third section went on towards it, 0.07 um/s.
    config = config_of(configs, "tendon3")
    run = Run.of(config, Mode.STOPPING)
    first = (0.0015797098174934418, -0.0010215909816136204, -0.0003179313960526109)
    ways = (*first, 0.0004354948768548928, -0.0009258160350606792, 0.0009348958401172657)
    command = (*ways, 0.00015579329389312323, -0.0009462800985371388, 0.0008044305387067606)
    end = (*ways, -0.00011804630818783407, -0.001006409679159443, 0.0007443009580876692)
    step = (*(0.0,) * 6, -7.331410581976148e-10, 3.584462352585957e-10, 3.5844621736925986e-10)
    still = (0.0,) * len(end)
    motion = JerkLimitedStop(end, still, config.acceleration, config.jerk)
    run.state = replace(
        run.state, command=command, reference=end, increments=step, policy=StopPolicy.HOLD,
        motion=motion, motion_s=-1.0,
    )  # fmt: skip
    for _ in range(10):
        run.step(None)
    assert run.state.mode is Mode.OFF
    assert run.state.command == pytest.approx(command, abs=1e-8)
