"""What is described of a robot: its reach, the bounds of its tip, the lines of its body and of its modes.

The surface is closed, its normals point out, and tips that the model computes are inside; the bounds contain
rest and every tip that random actuations reach.
"""

from __future__ import annotations

import random

import numpy as np
import pytest

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.robot_file.load import load_named
from contid_dynamics.report import pose_modes
from contid_panel.geometry import MODES, PanelGeometry, modes
from contid_panel.reach_surface import CELLS, ReachSurface, reach_surface
from contid_panel.samples import drawn, tip_mm

#: Share of the size of the box by which the farthest of many random tips may lie outside.
SLACK = 0.02


def solid_angle(surface: ReachSurface, point: Array) -> float:
    """How often a surface goes around a point, by the solid angles of its triangles (Oosterom 1983)."""
    a, b, c = (surface.points[surface.faces[:, k]] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(each, axis=1) for each in (a, b, c))
    triple = np.einsum("ij,ij->i", a, np.cross(b, c))
    below = (
        la * lb * lc
        + np.einsum("ij,ij->i", a, b) * lc
        + np.einsum("ij,ij->i", b, c) * la
        + np.einsum("ij,ij->i", c, a) * lb
    )
    return float(np.arctan2(triple, below).sum() / (2.0 * np.pi))


@pytest.mark.parametrize("name", ["stiffflop2", "tendon3", "trirack"])
def test_a_reach_is_a_closed_surface_around_its_tips(name: str) -> None:
    (robot,) = PanelGeometry(load_named(name), 100.0).scene.robots
    surface = reach_surface(robot)
    assert surface is not None
    edges = np.sort(np.concatenate([surface.faces[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all()
    # Other tips than those that made it: uniformly random axes.
    tips = [tip for each in drawn(robot)[:150] if (tip := tip_mm(robot, each)) is not None]
    inside = [solid_angle(surface, tip) > 0.5 for tip in tips]
    assert np.mean(inside) > 0.95
    cell = float(np.ptp(np.array(tips), axis=0).max()) / CELLS
    middle = np.mean(tips, axis=0)
    far = middle + 40.0 * cell
    assert solid_angle(surface, far) == pytest.approx(0.0, abs=1e-6)


def test_the_straight_arm_is_within_two_cells_of_its_reach() -> None:
    (robot,) = PanelGeometry(load_named("tendon3"), 100.0).scene.robots
    surface = reach_surface(robot)
    assert surface is not None
    tip = tip_mm(robot, robot.config.rest)
    assert tip is not None
    cell = float(np.ptp(surface.points, axis=0).max()) / CELLS
    near = float(np.linalg.norm(surface.points - tip, axis=1).min())
    assert solid_angle(surface, tip) > 0.5 or near < 2.0 * cell


@pytest.mark.parametrize(
    "name",
    [
        "hand", "tendon3", "trirack", "stiffflop2",
        *(pytest.param(each, marks=pytest.mark.campaign) for each in ("ftdcr_v4", "cbha", "stiffflop1")),
    ],
)  # fmt: skip
def test_bounds_contain_rest_the_ends_of_all_axes_and_random_tips(name: str) -> None:
    geometry = PanelGeometry(load_named(name), 200.0)
    described = geometry.describe()["robots"]
    numbers = random.Random(7)
    for robot in geometry.scene.robots:
        low, high = (np.array(each) for each in described[robot.config.name]["bounds"])
        model = robot.config.model
        for actuation in (robot.config.rest, model.lower, model.upper):
            tip = tip_mm(robot, actuation)
            assert tip is None or (np.all(tip > low - 0.01) and np.all(tip < high + 0.01)), (name, tip)
        limits = list(zip(model.lower, model.upper, strict=True))
        spread = [tuple(numbers.uniform(*each) for each in limits) for _ in range(1000)]
        tips = np.array([tip for each in spread if (tip := tip_mm(robot, each)) is not None])
        outside = np.maximum(low - tips, tips - high).max(axis=0)
        assert np.all(outside <= SLACK * np.maximum(high - low, 1.0)), (name, outside)


@pytest.mark.parametrize("name", ["hand", "trirack", "bend1", "catheter", "planar2", "tendon3", "trunk"])
def test_lines_of_a_body_are_its_backbone_then_tendons_then_discs(name: str) -> None:
    """Also where a motor winds several tendons, so that there are fewer axes than tendons."""
    geometry = PanelGeometry(load_named(name), 200.0)
    described = geometry.describe()["robots"]
    for robot in geometry.scene.robots:
        drawing = robot.drawing(robot.config.rest)
        assert drawing is not None
        found = described[robot.config.name]
        edges = 2 * robot.planar
        assert len(drawing.strips) == drawing.sections + found["tendons"] + found["discs"] + edges


def test_lines_are_of_the_modes_and_keep_their_length() -> None:
    loaded = load_named("stiffflop2")
    geometry, actuation = PanelGeometry(loaded, 100.0), (3e4, 0.0, 0.0, 2e4, 0.0, 0.0)
    (name, robot), *_ = loaded.driven.items()
    found = modes(geometry, name, actuation)["modes"]
    expected = pose_modes(robot, actuation, MODES).modes
    assert [each["frequency_hz"] for each in found] == [each.frequency_hz for each in expected]
    for mode in found:
        low, rest, high = np.array(mode["lines"])
        lengths = [np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in (low, rest, high)]
        assert max(lengths) < 1.02 * min(lengths)
        moved = np.linalg.norm(high - rest, axis=1)
        assert moved[0] == 0.0
        assert (
            0.15 * lengths[1] < moved.max() < 0.45 * lengths[1]
        )  # a double bend moves more than in proportion


def test_a_robot_without_dynamics_has_a_reason() -> None:
    loaded = load_named("finger")
    (name,) = loaded.driven
    with pytest.raises(ContidError, match="no dynamics in its robot file"):
        modes(PanelGeometry(loaded, 100.0), name, (0.05, 0.05))
