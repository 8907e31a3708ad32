"""Distances against dense sampling and scipy's minimisation of arcs, random configurations."""

import os
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from contid.kernels import load
from contid.kinematics.extra_axes import build_whole_model
from contid.robot_file.load import load_named
from contid.targets import ZERO3
from contid_clearance.arm import SPEED_FACTOR, body_speeds
from contid_clearance.body import Body, sampled_body
from contid_clearance.distances import between_bodies, to_obstacle
from contid_clearance.file_clearance import clearance_guard
from contid_clearance.guard import Shapes
from contid_clearance.obstacles import Box, Capsule, Plane
from tests.campaign.script import close_hand
from tests.clearance.arcs import random_chain
from tests.clearance.dense import run

CONFIGURATIONS = int(os.environ.get("CLEARANCE_CONFIGURATIONS", "40"))
#: What a body of an arc chain may add to the truth [m]: twice the allowance between its samples.
TOLERANCE_M = 6e-5


def refined(function, start, bounds):
    """The least value near a start, by scipy."""
    return min(function(start), minimize(function, start, bounds=bounds, method="L-BFGS-B").fun)


def true_distance(a, b):
    """Of two curves: 401 samples each, then scipy from the best."""
    s, t = np.linspace(0, a.length, 401), np.linspace(0, b.length, 401)
    apart, index = cKDTree(b.at(t)).query(a.at(s))
    best = int(apart.argmin())

    def distance(x):
        return float(np.linalg.norm(a.at(x[0])[0] - b.at(x[1])[0]))

    start = np.array([s[best], t[index[best]]])
    return min(float(apart.min()), refined(distance, start, [(0, a.length), (0, b.length)]))


@pytest.mark.slow
def test_two_arms_are_never_accepted_nearer_than_they_are():
    rng = np.random.default_rng(1)
    falsely_refused = penetrations = 0
    for _ in range(CONFIGURATIONS):
        a, b = random_chain(rng, 0.12), random_chain(rng, 0.12)
        radii = rng.uniform(0.002, 0.03, 2)
        found = between_bodies(sampled_body(a.evenly, radii[0]), sampled_body(b.evenly, radii[1]))
        dense = float(cKDTree(b.evenly(401)).query(a.evenly(401))[0].min()) - radii.sum()
        # The samples are at most 1.5 mm apart: only near the decision is the exact minimum worth its time.
        truth = dense if dense > found.upper_m + 2e-3 else true_distance(a, b) - radii.sum()
        assert found.lower_m <= truth + 1e-9
        assert truth <= dense
        assert found.lower_m <= found.upper_m
        if truth is not dense:
            assert truth - found.lower_m < TOLERANCE_M
        penetrations += bool(truth < 0.0)
        falsely_refused += bool(truth >= 1e-3 > found.lower_m)
    assert penetrations > CONFIGURATIONS / 20
    assert falsely_refused <= 0.02 * CONFIGURATIONS


def random_obstacle(rng):
    at = rng.uniform(-0.2, 0.2, 3)
    kind = rng.integers(4)
    if kind == 0:
        normal = rng.normal(size=3)
        return Plane(at, normal / np.linalg.norm(normal))
    if kind == 1:
        return Capsule(at, at, rng.uniform(0.01, 0.1))
    if kind == 2:
        return Capsule(at, at + rng.uniform(-0.1, 0.1, 3), rng.uniform(0.01, 0.05))
    return Box(at, Rotation.random(random_state=rng).as_matrix(), rng.uniform(0.005, 0.1, 3))


def test_obstacles_bound_the_dense_sampling():
    rng = np.random.default_rng(2)
    for _ in range(CONFIGURATIONS):
        curve, obstacle, radius = random_chain(rng, 0.2), random_obstacle(rng), rng.uniform(0.002, 0.03)
        found = to_obstacle(sampled_body(curve.evenly, radius), obstacle)
        s = np.linspace(0, curve.length, 2001)
        values = obstacle.signed_distance(curve.at(s)) - radius
        dense = float(values.min())
        spacing = s[1]
        assert found.lower_m <= dense + 1e-9
        assert dense - found.lower_m < TOLERANCE_M + 0.5 * spacing
        assert found.lower_m <= found.upper_m + 1e-12


def test_the_signed_distance_of_a_box_is_the_distance_to_its_nearest_point():
    rng = np.random.default_rng(3)
    for _ in range(50):
        box = Box(rng.normal(size=3), Rotation.random(random_state=rng).as_matrix(), rng.uniform(0.1, 1, 3))
        point = rng.uniform(-3, 3, 3)

        def apart(x, box=box, point=point):
            return float(np.linalg.norm(box.center + box.rotation @ x - point))

        bounds = list(zip(-box.half, box.half, strict=True))
        found = minimize(apart, np.zeros(3), bounds=bounds, tol=1e-14).fun
        assert max(float(box.signed_distance(point[None])[0]), 0.0) == pytest.approx(found, abs=1e-5)
    cube = Box(np.zeros(3), np.eye(3), np.array([1.0, 2.0, 3.0]))
    assert cube.signed_distance(np.array([[0.5, 0, 0], [0, 0, 0]])) == pytest.approx([-0.5, -1.0])


@pytest.mark.slow
def test_segments_against_scipy_also_when_parallel_crossing_or_points():
    rng = np.random.default_rng(4)
    for case in range(16):
        p, u, q, v = rng.uniform(-1, 1, (4, 3))
        if case % 4 == 1:
            v = u * rng.uniform(-2, 2) + 1e-12 * v
        if case % 4 == 2:
            q = p + 0.3 * u - 0.4 * v  # they cross
        if case % 8 == 7:
            u = np.zeros(3)
        # Two points each, as far apart along the curve as they are: nothing lies beside the chords.
        a = Body(np.stack((p, p + u)), float(np.linalg.norm(u)), 0.0)
        b = Body(np.stack((q, q + v)), float(np.linalg.norm(v)), 0.0)
        found = between_bodies(a, b)
        got = found.lower_m
        assert found.upper_m == pytest.approx(got, abs=1e-7)

        def apart(x, p=p, u=u, q=q, v=v):
            return float(np.sum((p + x[0] * u - q - x[1] * v) ** 2))

        starts = [(a, b) for a in (0.1, 0.9) for b in (0.1, 0.9)]
        truth = min(minimize(apart, x, bounds=[(0, 1)] * 2, tol=1e-16).fun for x in starts) ** 0.5
        assert got == pytest.approx(truth, abs=2e-6)


def test_a_part_is_not_nearer_and_contains_its_ends():
    rng = np.random.default_rng(5)
    for _ in range(50):
        curve = random_chain(rng)
        body = sampled_body(curve.evenly, 0.01)
        part = body.part(0.3 * curve.length, 0.8 * curve.length)
        assert part.start_m == pytest.approx(0.3 * curve.length)
        assert part.start_m + part.pieces * part.spacing_m == pytest.approx(0.8 * curve.length)
        plane = Plane(np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0]))
        assert to_obstacle(part, plane).lower_m >= to_obstacle(body, plane).lower_m - TOLERANCE_M


def test_enough_stops_early_without_a_wrong_answer():
    rng = np.random.default_rng(6)
    for _ in range(60):
        a, b = (sampled_body(random_chain(rng).evenly, 0.01) for _ in range(2))
        full, quick = between_bodies(a, b), between_bodies(a, b, enough_m=0.02)
        assert (quick.lower_m >= 0.02) == (full.lower_m >= 0.02)
        assert quick.lower_m <= full.upper_m


def test_a_curve_between_coarse_samples_is_not_missed():
    """A half circle given by its two ends and their arc length bulges half its diameter off the chord."""
    ends = np.array([[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0]])
    body = Body(ends, 0.1 * np.pi, 0.0)
    found = to_obstacle(body, Plane(np.array([0.0, -0.1, 0.0]), np.array([0.0, 1.0, 0.0])))
    assert found.lower_m <= 0.0


@pytest.mark.slow
def test_many_pairs_against_dense_sampling():
    """The long form: python -m tests.clearance.dense 1000000."""
    counts = run(150, 1)
    assert counts.penetrations > 7
    assert counts.penetrations_accepted == counts.nearer_than_bound == 0
    assert counts.falsely_refused <= 0.02 * counts.accepted


def test_a_straight_body_has_the_distances_of_a_line():
    """Lower and upper bound are the same, and the nearest place is known, also off the middle."""
    line = np.stack([np.zeros(65), np.zeros(65), np.linspace(0.0, 0.64, 65)], axis=1)
    body = Body(line, 0.01, 0.02, start_m=0.1)
    for z in (0.003, 0.1234, 0.31, 0.4, 0.6393):
        at = np.array([0.1, 0.0, z])
        ball = Capsule(at, at, 0.03)
        side = np.array((0.0, 0.2, 0.0))
        across = Body(np.stack((at - side, at + side)), 0.4, 0.03)
        for found in (to_obstacle(body, ball), between_bodies(body, across)):
            assert found.lower_m == pytest.approx(0.05, abs=1e-7)
            assert found.upper_m == pytest.approx(0.05, abs=1e-7)
            assert found.at_m == pytest.approx(0.1 + z, abs=0.011)
    for enough in (0.04, 0.06):
        assert (to_obstacle(body, ball, enough).lower_m >= enough) == (enough < 0.05)
        assert (between_bodies(body, across, enough).lower_m >= enough) == (enough < 0.05)


def test_a_slack_curve_is_bounded_by_its_chord_and_its_length():
    """Two samples 1 apart with an arc length of 1.25: the curve stays within 0.375 of its chord."""
    body = Body(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), 1.25, 0.0)
    wall = Plane(np.array([0.0, -2.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    found = to_obstacle(body, wall)
    assert found.lower_m == pytest.approx(2.0 - 0.375, abs=1e-6)
    assert found.upper_m == pytest.approx(2.0, abs=1e-12)
    other = Body(np.array([[0.0, 2.0, 0.0], [1.0, 2.0, 0.0]]), 1.0, 0.0)
    found = between_bodies(body, other)
    assert (found.lower_m, found.upper_m) == pytest.approx((2.0 - 0.375, 2.0 + 0.375), abs=1e-9)


def test_wrong_arrays_are_refused():
    kernel = load("clearance")
    line, packed = np.zeros((3, 3)), Capsule(np.zeros(3), np.zeros(3), 1.0).packed
    for points in (np.zeros((1, 3)), np.zeros((3, 2))):
        with pytest.raises(ValueError, match="points: an array"):
            kernel.between(points, 0.1, line, 0.1, 1.0)
        with pytest.raises(ValueError, match="points: an array"):
            kernel.between(line, 0.1, points, 0.1, 1.0)
        with pytest.raises(ValueError, match="points: an array"):
            kernel.to_obstacle(points, 0.1, packed, 1.0)
    with pytest.raises(ValueError, match="17 numbers"):
        kernel.to_obstacle(line, 0.1, packed[:16].copy(), 1.0)


def test_bodies_swapped_have_the_same_distance():
    kernel, rng = load("clearance"), np.random.default_rng(8)
    for _ in range(100):
        a, b = (sampled_body(random_chain(rng, 0.12).evenly, 0.01) for _ in range(2))
        there = kernel.between(a.points, a.spacing_m, b.points, b.spacing_m, np.inf)
        back = kernel.between(b.points, b.spacing_m, a.points, a.spacing_m, np.inf)
        assert there.lower == pytest.approx(back.lower, abs=1e-12)
        assert there.upper == pytest.approx(back.upper, abs=1e-12)
        places = [int(2 * each) // 2 for each in (there.at, there.other_at)]
        apart = np.linalg.norm(a.points[places[0]] - b.points[places[1]])
        assert apart <= there.upper + 2.0 * (a.spacing_m + b.spacing_m)


def test_points_that_are_not_numbers_are_refused_not_far_away():
    line = np.stack([np.zeros(33), np.zeros(33), np.linspace(0, 0.1, 33)], axis=1)
    broken = line.copy()
    broken[7, 1] = np.nan
    with pytest.raises(ValueError, match="finite"):
        between_bodies(Body(line, 0.1 / 32, 0.01), Body(broken, 0.1 / 32, 0.01))
    with pytest.raises(ValueError, match="finite"):
        to_obstacle(Body(broken, 0.1 / 32, 0.01), Plane(np.zeros(3), np.array([0.0, 0.0, 1.0])))


@pytest.mark.slow
def test_a_part_of_a_body_ends_where_it_has_to():
    """Against 4001 samples of the part; whole pieces made it up to 2 mm longer, in jumps."""
    rng = np.random.default_rng(6)
    for _ in range(15):
        a, b = random_chain(rng, 0.12), random_chain(rng, 0.12)
        radii = rng.uniform(0.002, 0.01, 2)
        free = rng.uniform(0.05, 0.6) * a.length
        first, second = sampled_body(a.evenly, radii[0]), sampled_body(b.evenly, radii[1])
        part = first.part(0.1 * free, a.length - free)
        s = np.linspace(0.1 * free, a.length - free, 4001)
        truth = float(cKDTree(b.evenly(4001)).query(a.at(s))[0].min()) - radii.sum()
        found = between_bodies(part, second)
        assert found.lower_m - 1e-6 <= truth <= found.upper_m + 1e-6
        assert found.upper_m - found.lower_m < 4.0 * TOLERANCE_M
        wall = random_obstacle(rng)
        truth = float(wall.signed_distance(a.at(s)).min()) - radii[0]
        found = to_obstacle(part, wall)
        assert found.lower_m - 1e-6 <= truth <= found.upper_m + 1e-6


def test_the_distance_of_fingers_changes_no_faster_than_they_move():
    """The hand in small steps past a length at which a piece of the free tip was counted as body."""
    loaded = close_hand()
    guard = clearance_guard(loaded)
    assert guard is not None
    left, right = guard.arms["left"], guard.arms["right"]
    before = None
    for share in np.linspace(0.0, 1.0, 60):
        at = (0.0590, 0.0795), (0.0346 + 5e-4 * share, 0.0382 + 5e-4 * share)
        shapes = Shapes(guard, {"left": (at[0], ZERO3), "right": (at[1], ZERO3)})
        found = shapes.nearest(("left", "right")).distance
        if before is not None:
            motion = right.motion_m(before[0], at[1]) + left.motion_m(at[0], at[0])
            assert abs(found.lower_m - before[1].lower_m) <= motion + 2.0 * TOLERANCE_M
        before = at[1], found


@pytest.mark.parametrize("name", ["finger", "trirack2", "tendon3", "stiffflop2"])
def test_points_of_a_body_come_no_nearer_to_each_other_than_its_bound(name):
    """Distances of 65 points of the shape before and after motions of a tenth of the ranges."""
    robot = next(iter(load_named(name).file.robots.values()))
    model, rng = build_whole_model(robot), np.random.default_rng(4)
    own = len(robot.axis_names)
    speeds, low, high = body_speeds(model, own), np.array(model.lower), np.array(model.upper)
    for _ in range(40):
        before, way = rng.uniform(low, high), rng.uniform(-0.1, 0.1, len(low)) * (high - low)
        after = np.clip(before + way, low, high)
        a, b = (model.shape(tuple(each.tolist()), 65) for each in (before, after))
        bound = float(np.dot(speeds.of_distances, np.abs(after - before)))
        assert np.abs(cdist(a, a) - cdist(b, b)).max() <= bound


class Levers:
    """Axis k moves the end of a straight body by ``k + 1`` times its change."""

    def __init__(self, axes):
        self.lower, self.upper = (-0.01,) * axes, (0.01,) * axes

    def shape(self, actuation, points):
        end = sum((k + 1) * each for k, each in enumerate(actuation))
        return np.linspace(0.0, 1.0, points)[:, None] * np.array([end, 0.0, 0.3])


@pytest.mark.parametrize("axes", [1, 24, 25, 64])
def test_the_speed_of_a_body_is_bounded_for_every_number_of_axes(axes):
    """A tendon robot has up to eight sections of up to eight tendons."""
    model: Any = Levers(axes)
    speeds = body_speeds(model, axes)
    assert speeds.of_points == pytest.approx([SPEED_FACTOR * (k + 1) for k in range(axes)], rel=1e-6)
