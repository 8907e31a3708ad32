"""Robots of a file in motion: equilibria of their statics, modes from another derivation, `contid modes`."""

from __future__ import annotations

import copy
import json
import math
import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner
from ruamel.yaml import YAML

from contid.errors import ContidError
from contid.kinematics.model import build_model
from contid.robot_file import load as load_module
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_named, parse_robot_file
from contid.robot_file.rates import InputShape
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import Target
from contid.units import STANDARD_GRAVITY
from contid_devices.homing.moving_commands import require_writable
from contid_dynamics import schedule
from contid_dynamics.arm import MovingArm
from contid_dynamics.command import command
from contid_dynamics.pose_option import actuation_at
from contid_dynamics.report import pose_modes, range_over_poses
from tests.oracles.rod_energies import energy_frequencies

SHIPPED = ("stiffflop1", "stiffflop2", "chambers3", "bend1", "tendon3", "ftdcr_v4")


def robot_of(name: str, **changes: object) -> Cosserat | TendonRobot:
    (robot,) = load_named(name).file.robots.values()
    assert isinstance(robot, (Cosserat, TendonRobot))
    assert robot.dynamics is not None
    return robot.model_copy(update={"dynamics": robot.dynamics.model_copy(update=changes)})


def actuation_of(robot: Cosserat | TendonRobot, seed: int) -> list[float]:
    """Pulls of a random bend, pressures at random."""
    rng = np.random.default_rng(seed)
    if isinstance(robot, Cosserat):
        pressures: list[float] = rng.uniform(0.0, 1.2e5, len(robot.axis_names)).tolist()
        return pressures
    model = build_model(robot)
    pose = model.forward(tuple(rng.uniform(-2e-3, 2e-3, len(robot.axis_names))))
    several = len(robot.geometry.sections) > 1
    found = model.inverse(Target(tip_m=pose.tip_m, direction=pose.direction if several else None), robot.rest)
    assert found.converged
    return list(found.actuation)


@pytest.mark.parametrize("name", SHIPPED)
def test_a_robot_in_motion_comes_to_rest_in_the_equilibrium_of_its_statics(name: str) -> None:
    robot = robot_of(name)
    arm, model = MovingArm(robot), build_model(robot)
    for seed in range(3):
        actuation = actuation_of(robot, seed)
        arm.settle(actuation)
        assert np.linalg.norm(arm.tip_m - model.forward(tuple(actuation)).tip_m) < 5e-5


@pytest.mark.parametrize(("name", "elements"), [("stiffflop1", 16), ("stiffflop2", 12)])
def test_a_force_on_the_tip_bends_it_as_in_the_statics(name: str, elements: int) -> None:
    robot = robot_of(name, elements=elements)
    arm, model = MovingArm(robot), build_model(robot)
    force = (0.01, -0.005, 0.02)
    actuation = actuation_of(robot, 1)
    arm.settle(actuation, force)
    assert np.linalg.norm(arm.tip_m - model.forward(tuple(actuation), force).tip_m) < 1e-4


def test_the_first_frequency_of_a_pneumatic_arm_is_that_of_a_beam() -> None:
    """Of one section at rest: Euler's beam with E I of the file; shear and rotary inertia slow it."""
    robot = robot_of("stiffflop1", elements=16)
    assert isinstance(robot, Cosserat)
    (section,) = robot.geometry.sections
    solid = section.radius_mm**4 - section.channel_radius_mm**4 - 6 * section.chamber_radius_mm**4
    chambers = 3.0 * section.chamber_placement_mm**2 * np.pi * section.chamber_radius_mm**2
    inertia = (np.pi / 4.0 * solid - chambers) * 1e-12
    beam = (
        1.8751**2
        / (2 * np.pi * (section.length_mm * 1e-3) ** 2)
        * np.sqrt(section.modulus_pa[4] * inertia / 0.133)
    )
    found = pose_modes(robot, robot.rest, 2).modes[0]
    assert 0.9 * beam < found.frequency_hz / np.sqrt(1.0 - found.ratio**2) < beam


@pytest.mark.parametrize("name", SHIPPED)
def test_the_first_frequency_is_that_of_many_elements(name: str) -> None:
    robot = robot_of(name)
    many = pose_modes(robot_of(name, elements=32), robot.rest, 1).modes[0]
    found = pose_modes(robot, robot.rest, 1).modes[0]
    assert found.frequency_hz == pytest.approx(many.frequency_hz, rel=0.005)


@pytest.mark.parametrize("name", SHIPPED)
def test_the_first_frequency_is_that_of_the_second_derivatives_of_the_energies(name: str) -> None:
    """At a bent pose; `tests.oracles.rod_energies` computes it without the kernel."""
    robot = robot_of(name, elements=3)
    arm, actuation = MovingArm(robot), actuation_of(robot, 1)
    arm.settle(actuation)
    found = arm.rod.modes().frequency_hz[0]
    assert found == pytest.approx(energy_frequencies(arm, actuation)[0], rel=1e-3)


def test_a_payload_slows_the_arm_and_hangs_straight() -> None:
    robot = robot_of("stiffflop2")
    light, heavy = pose_modes(robot, robot.rest, 1), pose_modes(robot, robot.rest, 1, payload_g=10.0)
    assert heavy.modes[0].frequency_hz < 0.8 * light.modes[0].frequency_hz
    assert heavy.tip_mm[2] > light.tip_mm[2]


@pytest.mark.process
def test_the_command_prints_modes_and_names_what_is_missing(
    contid: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    done = contid("modes", "tendon3", "--at", "s1.t1_mm=3", "--count", "2", "--json")
    assert done.returncode == 0, done.stderr
    arm = json.loads(done.stdout)["arm"]
    assert len(arm["modes"]) == 2
    assert len(arm["nodes_mm"]) == len(arm["modes"][0]["shape_mm"]) == 37
    assert "7.4" in contid("modes", "tendon3").stdout
    none = contid("modes", "finger")
    assert none.returncode == 2
    assert "no robot has 'dynamics'" in none.stderr
    wrong = contid("modes", "stiffflop2", "--at", "p=3")
    assert wrong.returncode == 2
    assert "allowed: s1.p1_bar" in wrong.stderr


@pytest.mark.parametrize(
    ("at", "words"),
    [
        ("tendon3 s1.t1_mm=nan", "allowed: COLUMN=NUMBER"),
        ("tendon3 s1.t1_mm=500", "outside the limits of the axis, -"),
        ("stiffflop2 s1.p1_bar=60", "outside the limits of the axis, 0 to "),  # kPa
        ("stiffflop2 s1.p1_bar=-0.1", "outside the limits of the axis, 0 to "),
    ],
)
def test_a_pose_that_is_none_is_refused(at: str, words: str) -> None:
    robot, pose = at.split()
    done = CliRunner().invoke(command, [robot, "--at", pose])
    assert done.exit_code != 0
    assert words in done.output + str(done.exception)


def test_the_range_over_poses_has_the_frequencies_of_the_table() -> None:
    """A mode above critical damping was 0 Hz in the table and 20 to 31 Hz over poses."""
    robot = load_named("stiffflop1").driven["arm"]
    assert isinstance(robot, Cosserat)
    assert robot.dynamics is not None
    slow = robot.model_copy(update={"dynamics": robot.dynamics.model_copy(update={"damping_ms": 400.0})})
    assert pose_modes(slow, robot.rest, 2).modes[0].frequency_hz == 0.0
    assert range_over_poses(slow, 2, 2) == [(0.0, 0.0)] * 2
    light = range_over_poses(robot, 2, 1)[0]
    undamped = range_over_poses(robot, 2, 1, undamped=True)[0]
    assert all(0.9 * b < a < b for a, b in zip(light, undamped, strict=True))


def test_a_mode_that_never_stops_has_no_time_in_json(tmp_path: Path) -> None:
    path = tmp_path / "arm.yaml"
    path.write_text(re.sub(r"damping_ms: [0-9.]+", "damping_ms: 0", load_named("tendon3").text))
    done = CliRunner().invoke(command, [str(path), "--count", "1", "--json"])
    assert done.exit_code == 0, done.output
    assert "Infinity" not in done.output
    assert json.loads(done.output)["arm"]["modes"][0]["settles_s"] is None


def test_a_schedule_is_written_and_lies_about_the_frequencies_of_the_model(tmp_path: Path) -> None:
    """Of two near frequencies 0.9 and 1.1 times the one between; at rest it has the printed one."""
    path = tmp_path / "arm.yaml"
    path.write_text(load_named("stiffflop1").text)
    done = CliRunner().invoke(command, [str(path), "--schedule", "40", "--payload-g", "3", "--write"])
    assert done.exit_code == 0, done.output
    assert "fitted to 30 poses; error on 10 kept aside: first mode" in done.output
    (robot,) = load_named(str(path)).driven.values()
    assert robot.rates.shape is not None
    schedule = robot.rates.shape.schedule
    assert schedule is not None
    for payload_g in (0.0, 3.0):
        modes = pose_modes(robot, (0.9e5, 0.2e5, 0.4e5), 2, payload_g).modes
        found = schedule.frequencies([0.9, 0.2, 0.4], 1e-3 * payload_g * STANDARD_GRAVITY)
        between = math.sqrt(modes[0].frequency_hz * modes[1].frequency_hz)
        assert found == pytest.approx([0.9 * between, 1.1 * between], rel=0.05)
    printed = pose_modes(robot, robot.rest[:3], 1).modes[0]
    assert robot.rates.shape.frequency_hz == pytest.approx(printed.frequency_hz, rel=1e-3)


@pytest.mark.slow
def test_a_schedule_of_a_tendon_robot_is_right_near_straight_too() -> None:
    """Bends of random sections are seldom small together, and logarithms have no peak there: 28 % off."""
    (robot,) = load_named("tendon3").driven.values()
    found = schedule.schedule_of(robot, 140)
    shape = InputShape.model_validate(found.shape)
    assert shape.schedule is not None
    assert shape.schedule.polynomials == "squared_period"
    arm = MovingArm(robot)
    off = []
    for actuation in schedule.random_actuations(robot, 12, seed=9, share=0.25):
        arm.settle(actuation.tolist())
        true = schedule._apart(schedule._frequencies(arm, actuation[None, :]))[0]
        own = shape.schedule.frequencies(robot.quantity.from_si(actuation).tolist())
        off.append(np.abs(np.array(own) / true - 1.0))
    assert np.median(off) < 0.06
    assert np.quantile(off, 0.9) < 0.12


def test_a_schedule_of_a_tendon_robot_has_room_for_the_fall_of_tensions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("contid_dynamics.tension_swing._TRIES", 4)  # how much room: test_tension_in_motion.py
    path = tmp_path / "arm.yaml"
    path.write_text(load_named("bend1").text)
    done = CliRunner().invoke(command, [str(path), "--schedule", "20", "--write"])
    assert done.exit_code == 0, done.output
    assert "rates.shape, tension.swing_n written to" in done.output
    (robot,) = load_named(str(path)).driven.values()
    assert isinstance(robot, TendonRobot)
    assert robot.tension is not None
    assert robot.tension.swing_n > 0.0
    assert f"to {robot.tension.floor_n + robot.tension.swing_n:g} N" in done.output


def test_mistakes_of_a_schedule_are_named(tmp_path: Path) -> None:
    path = tmp_path / "arm.yaml"
    path.write_text(load_named("stiffflop1").text)
    alone = CliRunner().invoke(command, [str(path), "--write"])
    assert alone.exit_code == 2
    assert "--write needs --schedule COUNT" in alone.output
    few = CliRunner().invoke(command, [str(path), "--schedule", "8", "--write"])
    assert few.exit_code != 0
    assert "3 axes need at least 20 poses" in str(few.exception)
    assert path.read_text() == load_named("stiffflop1").text


@pytest.mark.parametrize("payload", ["nan", "inf"])
def test_a_payload_is_finite(payload: str) -> None:
    done = CliRunner().invoke(command, ["stiffflop1", "--payload-g", payload])
    assert done.exit_code == 2
    assert "not a finite number" in done.output


def test_mistakes_in_dynamics_are_located() -> None:
    text = load_named("stiffflop2").text
    with pytest.raises(ContidError, match="mass_g_per_m has 3 numbers; allowed: 1 or 2, one per section"):
        parse_robot_file(text.replace("mass_g_per_m: [133]", "mass_g_per_m: [1, 2, 3]"), "arm.yaml")
    with pytest.raises(ContidError, match="dynamics needs mass_g_per_m"):
        parse_robot_file(text.replace("mass_g_per_m: [133]", ""), "arm.yaml")


def two_arms(folder: Path) -> Path:
    yaml, path = YAML(), folder / "two.yaml"
    data = yaml.load(load_named("stiffflop1").text)
    arm = data["robots"]["arm"]
    other = copy.deepcopy(arm)
    for number, axis in enumerate(other["axes"].values()):
        axis["channel"] = f"p{number + 3}"
    data["robots"]["bee"] = other
    yaml.dump(data, path)
    return path


def test_the_pose_of_one_of_two_robots_leaves_the_other_at_rest(tmp_path: Path) -> None:
    path, column = two_arms(tmp_path), "arm.c1_bar"
    (alone,) = load_named("stiffflop1").driven.values()
    column = f"arm.{alone.axis_names[0]}_bar"
    shown = [
        CliRunner().invoke(command, [str(path), "--json", *at]) for at in ([], ["--at", f"{column}=0.6"])
    ]
    rest, bent = (json.loads(each.output) for each in shown)
    assert bent["bee"] == rest["bee"]
    assert bent["arm"] != rest["arm"]
    wrong = CliRunner().invoke(command, [str(path), "--at", "cat.p1_bar=0.6"])
    assert wrong.exit_code == 2
    assert "no such axis" in wrong.output


def test_the_schedules_of_two_robots_are_written_both_or_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = two_arms(tmp_path)
    before, found = path.read_text(), schedule.schedule_of
    asked: list[object] = []

    def fails_for_the_second(*arguments: Any) -> Any:
        asked.append(arguments)
        if len(asked) == 2:
            raise ContidError("swings too slowly")
        return found(*arguments)

    with monkeypatch.context() as patched:
        patched.setattr(schedule, "schedule_of", fails_for_the_second)
        done = CliRunner().invoke(command, [str(path), "--schedule", "20", "--write"])
        assert "swings too slowly" in str(done.exception)
    assert path.read_text() == before
    done = CliRunner().invoke(command, [str(path), "--schedule", "20", "--write"])
    assert done.exit_code == 0, done.output
    assert all(robot.rates.shape is not None for robot in load_named(str(path)).driven.values())


def test_a_shipped_file_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shipped = tmp_path / "configs"
    shipped.mkdir()
    (shipped / "stiffflop1.yaml").write_text(load_named("stiffflop1").text)
    monkeypatch.setattr(load_module, "configs_folder", lambda: shipped)
    done = CliRunner().invoke(command, ["stiffflop1", "--schedule", "20", "--write"])
    assert "`contid new NAME --from stiffflop1`" in str(done.exception)
    with pytest.raises(ContidError, match="is shipped with contid"):
        require_writable(load_module.find_robot_file("stiffflop1"), "home")
    require_writable(two_arms(tmp_path), "home")


def test_a_frequency_that_shaping_does_not_take_is_not_recommended(tmp_path: Path) -> None:
    path = tmp_path / "arm.yaml"
    path.write_text(load_named("stiffflop1").text.replace("mass_g_per_m: [133]", "mass_g_per_m: [100000]"))
    done = CliRunner().invoke(command, [str(path), "--count", "1"])
    assert done.exit_code == 0, done.output
    assert "0.37 Hz" in done.output
    assert "its first mode is not shaped: rates.shape takes 0.5 to 100 Hz" in done.output
    assert "rates with shape" not in done.output


def test_an_axis_is_given_once() -> None:
    (robot,) = load_named("tendon3").driven.values()
    for second in ("s1.t1_mm=4", "arm.s1.t1_mm=4"):
        with pytest.raises(click.UsageError, match="given before; each axis once"):
            actuation_at(robot, "arm", ("s1.t1_mm=3", second))


def test_a_robot_with_the_name_of_a_section_has_its_axes() -> None:
    (robot,) = load_named("tendon3").driven.values()
    assert actuation_at(robot, "s1", ("s1.t1_mm=3",)) == actuation_at(robot, "arm", ("arm.s1.t1_mm=3",))
