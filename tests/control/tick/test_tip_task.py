"""What a target asks for, by rotations of SciPy: turns between directions or frames, and derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contid.control.tick.tip_task import (
    between,
    displacement_of,
    jacobian_of,
    shifted,
    task_of,
    turn_of,
    turned,
)
from contid.targets import Target, Vec3
from tests.support.robot_configs import config_of, postures


def unit(rng: np.random.Generator) -> np.ndarray:
    vector: np.ndarray = rng.normal(size=3)
    vector /= np.linalg.norm(vector)
    return vector


def vec(array: np.ndarray) -> Vec3:
    x, y, z = array.tolist()
    return x, y, z


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, 2.9, 3.0999, 3.1001, math.pi - 1e-4, math.pi - 1e-9])
def test_a_turn_is_the_rotation_vector(angle: float) -> None:
    rng = np.random.default_rng(1)
    for _ in range(30):
        axis = unit(rng)
        rotation = Rotation.from_rotvec(angle * axis).as_matrix()
        for size in (1.0, 0.1):
            assert turn_of(rotation, size) == pytest.approx(size * angle * axis, abs=2e-8)


def test_half_a_turn_is_about_its_axis_with_either_sign() -> None:
    rng = np.random.default_rng(2)
    for _ in range(30):
        axis = unit(rng)
        found = np.array(turn_of(Rotation.from_rotvec(math.pi * axis).as_matrix()))
        assert np.linalg.norm(found) == pytest.approx(math.pi)
        assert abs(found @ axis) == pytest.approx(math.pi, abs=1e-7)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_directions_turn_along_the_great_circle(share: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(30):
        begin, end = unit(rng), unit(rng)
        axis = np.cross(begin, end)
        angle = math.atan2(float(np.linalg.norm(axis)), float(begin @ end))
        part = Rotation.from_rotvec(share * angle * axis / np.linalg.norm(axis))
        assert turned(vec(begin), vec(end), share) == pytest.approx(part.apply(begin), abs=1e-12)
        assert turned(vec(begin), vec(begin), share) == pytest.approx(begin, abs=1e-12)


@pytest.mark.parametrize("flat", [False, True])
def test_opposite_directions_turn_along_some_great_circle(flat: bool) -> None:
    """In a plane it stays in it, as robots in a plane have no other directions."""
    rng = np.random.default_rng(6)
    ends = [unit(rng) for _ in range(30)] + [np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])]
    for end in ends:
        if flat:
            end = np.array([math.cos(end[0]), math.sin(end[0]), 0.0])
        middle, whole = (np.array(turned(vec(-end), vec(end), share)) for share in (0.5, 1.0))
        assert np.linalg.norm(middle) == pytest.approx(1.0, abs=1e-12)
        assert middle @ end == pytest.approx(0.0, abs=1e-12)
        assert whole == pytest.approx(end, abs=1e-12)
        assert not flat or middle[2] == 0.0


def test_points_between_and_shifted() -> None:
    rng = np.random.default_rng(4)
    a, b, c = (rng.normal(size=3) for _ in range(3))
    assert between(vec(a), vec(b), 0.0) == vec(a)
    assert between(vec(a), vec(b), 0.25) == pytest.approx(0.75 * a + 0.25 * b)
    assert shifted(vec(a), vec(b), vec(c)) == pytest.approx(a + (c - b))


@pytest.mark.parametrize("kind", ["tip", "direction", "mid", "rotation"])
def test_the_derivative_is_that_of_the_rows(kind: str) -> None:
    config, rng = config_of("trirack2"), np.random.default_rng(5)
    start, tip_m = postures(config, rng, 0.3, 0.6)
    own = len(start) - config.extra_axes
    extra, at = start[own:], np.array(start[:own])
    goal = config.model.forward(tuple(1.01 * value for value in start))
    target = {
        "tip": Target(tip_m=tip_m),
        "direction": Target(tip_m=tip_m, direction=goal.direction),
        "mid": Target(tip_m=tip_m, mid_m=goal.mid_m),
        "rotation": Target(tip_m=tip_m, rotation=goal.rotation),
    }[kind]
    task = task_of(config, target, extra)
    assert len(task(at)) == (3 if kind == "tip" else 6)
    middle = 0.5 * (np.array(config.model.lower[:own]) + np.array(config.model.upper[:own]))
    found = jacobian_of(task, at, task(at), config.limits, middle)
    for k in range(own):
        step = np.zeros(own)
        step[k] = 1e-6
        assert found[:, k] == pytest.approx((task(at + step) - task(at - step)) / 2e-6, rel=1e-3, abs=2e-3)


def test_at_the_end_of_an_axis_the_derivative_is_taken_inside() -> None:
    config = config_of("trirack2")
    own = len(config.rest) - config.extra_axes
    lower, upper = np.array(config.model.lower[:own]), np.array(config.model.upper[:own])
    asked: list[np.ndarray] = []

    def task(axes: np.ndarray) -> np.ndarray:
        asked.append(axes)
        return axes.copy()

    for end in (lower, upper):
        found = jacobian_of(task, end, task(end), config.limits, 0.5 * (lower + upper))
        assert found == pytest.approx(np.eye(own))
    assert all(np.all(axes >= lower) and np.all(axes <= upper) for axes in asked)


def test_a_displacement_has_the_turn_of_the_direction() -> None:
    """Its length is the angle between the directions, at 0.1 m per radian, and it begins across the first."""
    config, rng = config_of("trirack2"), np.random.default_rng(6)
    start, _ = postures(config, rng, 0.3, 0.6)
    end, _ = postures(config, rng, 0.3, 0.6)
    own = len(start) - config.extra_axes
    poses = [config.model.forward((*axes[:own], *start[own:])) for axes in (start, end)]
    target = Target(tip_m=poses[1].tip_m, direction=poses[1].direction)
    task = task_of(config, target, start[own:])
    last, step = np.array(start[:own]), np.array(end[:own]) - np.array(start[:own])
    moved = displacement_of(task, last, task(last), True)(step)
    assert moved[:3] == pytest.approx(np.subtract(poses[1].tip_m, poses[0].tip_m))
    angle = math.acos(float(np.dot(poses[0].direction, poses[1].direction)))
    assert np.linalg.norm(moved[3:6]) == pytest.approx(0.1 * angle)
    assert moved[3:6] @ poses[0].direction == pytest.approx(0.0, abs=1e-12)
    straight = displacement_of(task, last, task(last), False)(step)
    assert straight[3:6] == pytest.approx(0.1 * np.subtract(poses[1].direction, poses[0].direction))
