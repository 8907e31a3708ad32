"""The model from outside: SI, named limits, notes, every mode."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contid.kinematics.cosserat.model import ROLL_NOTE, CosseratModel, build_section
from contid.kinematics.model import build_model
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_robot_file
from contid.targets import Target
from contid.units import BAR
from tests.kinematics.cosserat_cases import GRAM


def describe(configs: Path, name: str, **changes: Any) -> Cosserat:
    robot = yaml.safe_load((configs / f"{name}.yaml").read_text(encoding="utf-8"))["robots"]["arm"]
    return Cosserat.model_validate({**robot, **changes})


@pytest.fixture
def arm(configs: Path) -> CosseratModel:
    model = build_model(describe(configs, "stiffflop2"))
    assert isinstance(model, CosseratModel)
    return model


SEED = (0.5 * BAR,) * 6


@pytest.mark.parametrize("name", ["chambers3", "stiffflop1", "stiffflop2"])
def test_emulated_twin_differs_only_in_its_wire(configs: Path, name: str) -> None:
    real, twin = load_robot_file(configs / f"{name}.yaml"), load_robot_file(configs / f"{name}.emulated.yaml")
    assert real.file.robots == twin.file.robots
    assert real.buses["regulators"].axes == twin.buses["regulators"].axes


def test_axes_and_limits(arm: CosseratModel) -> None:
    assert arm.axis_names == ("s1.p1", "s1.p2", "s1.p3", "s2.p1", "s2.p2", "s2.p3")
    assert arm.lower == (0.0,) * 6
    assert arm.upper == (1.5 * BAR,) * 6


@pytest.mark.parametrize("grams", [0.0, 5.0, 10.0])
def test_modes_meet_their_targets(arm: CosseratModel, grams: float) -> None:
    load = (0.0, 0.0, grams * GRAM)
    tip = (-0.008, 0.012, 0.118)
    decoupled = arm.inverse(Target(tip_m=tip, mid_m=(0.004, -0.003, 0.06), load_n=load), SEED)
    leaning = (0.5, 0.0, math.sqrt(0.75))
    posed = arm.inverse(Target(tip_m=tip, direction=leaning, load_n=load), SEED)
    alone = arm.inverse(Target(tip_m=tip, load_n=load), SEED)
    for solution in (decoupled, posed, alone):
        assert solution.converged
        assert solution.note == ""
        pose = arm.forward(solution.actuation, load)
        assert pose.stable
        assert math.dist(pose.tip_m, tip) < 2e-7
    assert math.dist(arm.forward(decoupled.actuation, load).mid_m, (0.004, -0.003, 0.06)) < 2e-7
    assert math.dist(arm.forward(posed.actuation, load).direction, leaning) < 1e-5


def test_seed_makes_no_difference_to_a_unique_answer(arm: CosseratModel) -> None:
    target = Target(tip_m=(-0.008, 0.012, 0.118), mid_m=(0.004, -0.003, 0.06), load_n=(0.0, 0.0, 5 * GRAM))
    answers = [arm.inverse(target, (x * BAR,) * 6).actuation for x in (0.1, 0.7, 1.4)]
    assert np.ptp(np.array(answers), axis=0).max() < 1e-4 * BAR


@pytest.mark.parametrize("height_m", [0.0909, 0.0912, 0.12, 0.135])
def test_a_tip_on_the_axis_has_one_answer_on_every_side(arm: CosseratModel, height_m: float) -> None:
    """Its mirrored solutions are equally good: not rounding chooses but a fixed side of the axis.

    A tip a billionth of a millimetre beside it, where the sign of rounding is another, has the same answer.
    """
    for pressure in (0.0, 0.3):
        seed = (pressure * BAR,) * 6
        first, *others = (
            arm.inverse(Target(tip_m=(x, y, height_m)), seed)
            for x, y in ((0.0, 0.0), (1e-12, 0.0), (-1e-12, 0.0), (0.0, 1e-12), (0.0, -1e-12))
        )
        assert first.converged
        assert math.dist(arm.forward(first.actuation).tip_m, (0.0, 0.0, height_m)) < 1e-7
        for other in others:
            assert other.actuation == pytest.approx(first.actuation, abs=1e-4 * BAR)


def test_out_of_reach_names_the_limits(arm: CosseratModel) -> None:
    solution = arm.inverse(Target(tip_m=(-0.02, 0.015, 0.12), mid_m=(0.008, -0.005, 0.06)), SEED)
    assert not solution.converged
    assert solution.limited_by == ("s2.p1.max",)
    assert solution.actuation[3] == 1.5 * BAR
    assert solution.residual_m == pytest.approx(3.0851e-3, abs=1e-6)
    assert "out of reach" in solution.note


@pytest.mark.parametrize("name", ["stiffflop1", "stiffflop2"])
def test_upright_overload_is_refused_with_the_critical_load(configs: Path, name: str) -> None:
    arm = build_model(describe(configs, name))
    seed = (0.5 * BAR,) * len(arm.axis_names)
    height = 0.055 if name == "stiffflop1" else 0.115
    solution = arm.inverse(Target(tip_m=(0.0, 0.0, height), load_n=(0.0, 0.0, -30.0 * GRAM)), seed)
    assert not solution.converged
    assert solution.actuation == seed
    assert solution.limited_by == ("stability",)
    grams = "12.2 g" if name == "stiffflop1" else "3.02 g"
    assert "buckles: at the present pressures it carries" in solution.note
    assert grams in solution.note
    assert not arm.forward(seed, (0.0, 0.0, -30.0 * GRAM)).stable


def test_pressures_pass_through(arm: CosseratModel) -> None:
    inside = tuple(x * BAR for x in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6))
    assert arm.inverse(Target(actuation=inside), SEED).actuation == inside
    outside = (2.0 * BAR, *inside[1:])
    clamped = arm.inverse(Target(actuation=outside), SEED)
    assert not clamped.converged
    assert clamped.limited_by[0] == "s1.p1.max"
    assert clamped.actuation[0] == 1.5 * BAR
    assert clamped.residual_m > 0.0


def test_jacobian_is_the_derivative_of_forward(configs: Path) -> None:
    arm = build_model(describe(configs, "stiffflop2", solver={"elements": 16}))
    p = np.array([0.3, 0.9, 0.1, 0.6, 0.2, 0.7]) * BAR
    load = (0.005, -0.01, 0.05)
    found = arm.jacobian(tuple(p), load)
    for column in range(6):
        step = np.zeros(6)
        step[column] = 1e-3 * BAR
        ahead, behind = arm.forward(tuple(p + step), load).tip_m, arm.forward(tuple(p - step), load).tip_m
        difference = (np.array(ahead) - behind) / (2e-3 * BAR)
        assert np.abs(difference - found[:, column]).max() < 1e-4 * np.abs(found).max()


def test_shape_goes_from_base_to_tip_at_equal_steps(arm: CosseratModel) -> None:
    p, load = tuple(x * BAR for x in (0.3, 0.9, 0.1, 0.6, 0.0, 0.7)), (0.0, 0.0, 5 * GRAM)
    line = arm.shape(p, 41, load)
    assert line.shape == (41, 3)
    assert np.abs(line[0]).max() == 0.0
    assert math.dist(line[-1], arm.forward(p, load).tip_m) < 1e-12
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    assert np.ptp(steps) < 2e-3 * steps.mean()


def test_own_weight_and_gravity(configs: Path) -> None:
    """Hanging, weight straightens the bent arm; lying, it pulls the tip down along gravity."""
    geometry = describe(configs, "stiffflop2").geometry.model_dump()
    for described in geometry["sections"]:
        described["density_kg_m3"] = 1070.0
    p = tuple(x * BAR for x in (0.3, 0.9, 0.1, 0.6, 0.0, 0.7))
    light = build_model(describe(configs, "stiffflop2")).forward(p)
    hung = build_model(describe(configs, "stiffflop2", geometry=geometry)).forward(p)
    assert hung.tip_m[2] > light.tip_m[2]
    lying = build_model(describe(configs, "stiffflop2", geometry=geometry, down=[2.0, 0.0, 0.0]))
    assert lying.forward(p).tip_m[0] > light.tip_m[0] + 1e-3
    reached = lying.forward(p)
    solution = lying.inverse(Target(tip_m=reached.tip_m, mid_m=reached.mid_m), SEED)
    assert solution.converged
    assert math.dist(lying.forward(solution.actuation).tip_m, reached.tip_m) < 2e-7


def test_elements_grow_with_the_load(configs: Path) -> None:
    arm = build_model(describe(configs, "stiffflop1", solver={"error_mm": 0.001}))
    assert isinstance(arm, CosseratModel)
    tip, seed = (20.0, 10.0, 55.0), (0.5, 0.5, 0.5)
    assert arm.engine.inverse(tip, None, None, (0.0, 0.0, 0.0), seed).elements == 3
    assert arm.engine.inverse(tip, None, None, (0.0, 0.0, 10 * GRAM), seed).elements > 3


@pytest.mark.parametrize("force", [(0.034, 0.017, 0.027), (-0.05, 0.06, 0.0), (0.0, 0.0, 0.0981)])
def test_forward_is_as_fine_as_the_inverse(configs: Path, force: tuple[float, float, float]) -> None:
    """To an estimated 0.03 mm; three elements alone would be 0.18 mm off in the first case."""
    pressures = tuple(p * BAR for p in (1.417, 1.219, 0.0, 0.296, 0.716, 0.579))
    coarse = build_model(describe(configs, "stiffflop2"))
    fine = build_model(describe(configs, "stiffflop2", solver={"elements": 48}))
    assert math.dist(coarse.forward(pressures, force).tip_m, fine.forward(pressures, force).tip_m) < 4e-5


def test_full_rotation_notes_that_roll_is_not_controlled(configs: Path) -> None:
    arm = build_model(describe(configs, "stiffflop2", solver={"orientation": "full_rotation"}))
    solution = arm.inverse(Target(tip_m=(0.03, 0.0, 0.12), direction=(0.0, 0.0, 1.0)), SEED)
    assert ROLL_NOTE in solution.note
    assert solution.converged  # in the plane of symmetry the roll fits
    off_plane = arm.inverse(Target(tip_m=(0.03, 0.0, 0.12), direction=(0.0, 0.5, math.sqrt(0.75))), SEED)
    assert not off_plane.converged


def test_description_refuses_impossible_sections(configs: Path) -> None:
    geometry = describe(configs, "stiffflop1").geometry.model_dump()
    for change, message in (
        ({"chamber_placement_mm": 7.0}, "stick out"),
        ({"chamber_placement_mm": 3.0}, "central channel"),
        ({"modulus_up_to_bar": 4.0, "modulus_pa": (0, 0, 0, -40000, 76130)}, "must be positive"),
        ({"link_mass_g": 1.0}, "link_mm"),
        ({"pair_angle_deg": 0.0}, "overlap.*at least 28.4.*single chambers"),
        ({"pair_angle_deg": None}, "pair_angle_deg is missing.*chambers: 3"),
        ({"chambers": 3}, "no meaning for three single chambers"),
    ):
        sections = [{**geometry["sections"][0], **change}]
        with pytest.raises(ValueError, match=message):
            describe(configs, "stiffflop1", geometry={**geometry, "sections": sections})
    with pytest.raises(ValueError, match="no axis"):
        describe(configs, "stiffflop1", limits={"pressure_bar": [0.0, 1.5], "max_bar": {"s2.p1": 1.0}})
    with pytest.raises(ValueError, match="evacuated"):
        describe(configs, "stiffflop1", limits={"pressure_bar": [-0.5, 1.5]})


def test_single_chambers_by_counting_a_grid_of_the_cross_section(configs: Path) -> None:
    """Area, second moments and the bend at one pressure, from a million squares of silicone and of air."""
    described = describe(configs, "chambers3")
    part = described.geometry.sections[0]
    edge = part.radius_mm / 600.0
    at = (np.arange(-600, 600) + 0.5) * edge
    x, y = np.meshgrid(at, at)
    radius = np.hypot(x, y)
    air = [
        np.hypot(
            x - part.chamber_placement_mm * math.cos(k * math.tau / 3.0),
            y - part.chamber_placement_mm * math.sin(k * math.tau / 3.0),
        )
        <= part.chamber_radius_mm
        for k in range(3)
    ]
    silicone = (radius <= part.radius_mm) & (radius > part.channel_radius_mm) & ~(air[0] | air[1] | air[2])
    area, inertia = edge**2 * silicone.sum(), edge**2 * (x**2)[silicone].sum()
    section = build_section(part)
    assert section.area == pytest.approx(area, rel=1e-3)
    assert section.inertia == pytest.approx(inertia, rel=1e-3)
    bar = 0.4
    modulus = section.modulus(bar / 3.0)[0]
    moment = 0.1 * bar * edge**2 * x[air[0]].sum()  # a bar on a mm^2 pushes with 0.1 N
    strain = 0.1 * bar * edge**2 * air[0].sum() / (modulus * area)
    # The bend per reference length grows with the strain of the axis.
    model = build_model(described)
    direction = model.forward((bar * BAR, 0.0, 0.0)).direction
    bend = math.atan2(math.hypot(*direction[:2]), direction[2])
    assert bend == pytest.approx(part.length_mm * moment / (modulus * inertia), rel=0.1 + strain)
    assert direction[0] < 0.0
