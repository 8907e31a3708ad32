"""What counts as a jump of the answers: not what a target itself asks for within one tick."""

from __future__ import annotations

import io
from dataclasses import replace

import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.preflight.jumps import jump_of
from contid.control.tick.preflight.rows import Preflight
from contid.errors import BadInputError
from contid.robot_file.load import load_named
from contid.targets import Target
from contid.trajectory.read import read_trajectory

RATE = 200.0
#: An answer of trirack2, from rest, and a change of it that turns the tip and hardly moves it [m].
BENT = (0.03, 0.02, 0.025, 0.03, 0.02, 0.025)
TURN = (-0.0008, -0.0003, -0.0003, 0.0018, -0.0002, -0.0001)


@pytest.fixture(scope="module")
def trirack2() -> RobotConfig:
    (config,) = build_robot_configs(load_named("trirack2"), RATE)
    return config


def poses(config: RobotConfig, share: float) -> Target:
    lengths = [rest + bent + share * turn for rest, bent, turn in zip(config.rest, BENT, TURN, strict=True)]
    pose = config.model.forward(tuple(lengths))
    return Target(tip_m=pose.tip_m, direction=pose.direction, rotation=pose.rotation, mid_m=pose.mid_m)


@pytest.mark.parametrize("kept", ["direction", "rotation", "mid_m"])
def test_a_target_that_turns_fast_makes_no_jump(trirack2: RobotConfig, kept: str) -> None:
    others = dict.fromkeys({"direction", "rotation", "mid_m"} - {kept})
    before, after = (replace(poses(trirack2, share), **others) for share in (0.0, 1.0))  # type: ignore[arg-type]
    first = trirack2.model.inverse(before, trirack2.rest).actuation
    second = trirack2.model.inverse(after, first).actuation
    assert jump_of(trirack2, before, after, (first, second)) is None


def test_a_load_that_changes_fast_makes_no_jump() -> None:
    (arm,) = build_robot_configs(load_named("stiffflop2"), RATE)
    tip_m = arm.model.forward((1.2e5, 0.4e5, 0.4e5, 1.0e5, 0.5e5, 0.5e5)).tip_m
    before, after = (Target(tip_m=tip_m, load_n=(0.0, 0.0, force_n)) for force_n in (0.0, -0.05))
    first = arm.model.inverse(before, arm.rest).actuation
    second = arm.model.inverse(after, first).actuation
    assert first != second
    assert jump_of(arm, before, after, (first, second)) is None


def test_an_extra_axis_beside_a_still_tip_is_too_fast_and_does_not_jump() -> None:
    loaded = load_named("cbha")
    rows = ((0.0, 0.0), (2.0, 0.0), (2.1, 15.0), (4.0, 15.0))
    text = "".join(f"{time_s},30,0,200,{wrist_mm}\n" for time_s, wrist_mm in rows)
    trajectory = read_trajectory(io.StringIO(f"t_s,x_mm,y_mm,z_mm,wrist_mm\n{text}"), "t.csv", loaded.driven)
    with pytest.raises(BadInputError, match=r"cbha\.wrist needs 224\.3 mm/s, limit 60 .*: slow down"):
        Preflight(build_robot_configs(loaded, RATE)).trajectory(trajectory, "t.csv")
