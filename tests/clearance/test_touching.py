"""Tips that may touch are not in each other, and a body is not in itself: against dense samples."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from contid.kinematics.array import Array
from contid.robot_file.load import find_robot_file, parse_robot_file
from contid.targets import ZERO3, Actuation, Target, vec3
from contid_clearance.file_clearance import clearance_guard
from contid_clearance.guard import ClearanceGuard, Shapes
from contid_clearance.walk import Walk

POINTS = 601


def guard_of(text: str) -> ClearanceGuard:
    guard = clearance_guard(parse_robot_file(text, "pair.yaml"))
    assert guard is not None
    return guard


def hand(**changes: Any) -> ClearanceGuard:
    """The shipped hand, its fingers 60 mm apart, with other values of its bodies and of ``clearance``."""
    data = yaml.safe_load(find_robot_file("hand").read_text(encoding="utf-8"))
    data["robots"]["right"]["base"]["x_mm"] = 60
    for body in data["clearance"]["bodies"].values():
        body.update({key: value for key, value in changes.items() if key.startswith("tip_r")})
    data["clearance"].update({key: value for key, value in changes.items() if not key.startswith("tip_r")})
    return guard_of(yaml.safe_dump(data))


def arms(name: str, apart_mm: float, body: dict[str, float]) -> ClearanceGuard:
    """Two arms of a shipped file beside each other."""
    data = yaml.safe_load(find_robot_file(name).read_text(encoding="utf-8"))
    ((_, arm),) = data["robots"].items()
    bus = {"a": {"driver": "sim"}}
    for axis in arm["axes"].values():
        kept = {key: axis[key] for key in axis if key in ("mm_per_rev", "zero_deg", "direction")}
        axis.clear()
        axis.update({"bus": "a", "device": "servo", **kept})
    arm.pop("placeholder", None)
    data["robots"] = {"one": arm, "two": {**arm, "base": {"x_mm": apart_mm}}}
    data["buses"] = bus
    data["clearance"] = {"margin_mm": 1, "bodies": {"one": body, "two": body}}
    return guard_of(yaml.safe_dump(data))


class Dense:
    """A body as dense points, by the model alone."""

    def __init__(self, guard: ClearanceGuard, name: str, actuation: Actuation) -> None:
        arm = guard.arms[name]
        points = arm.model.shape(actuation, POINTS)
        self.points = points @ np.array(arm.frame.rotation).reshape(3, 3).T + arm.frame.origin_in_world
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        self.along = np.concatenate([[0.0], np.cumsum(steps)])
        self.free = self.along > self.along[-1] - arm.tip_free_m

    def parts(self, free: bool) -> Array:
        return np.asarray(self.points[self.free == free])

    def own_m(self, apart_m: float) -> float:
        """Least distance of two points at least this far apart along the body."""
        thin, along = self.points[::3], self.along[::3]
        away = cdist(thin, thin)
        away[along[:, None] - along[None] < apart_m] = np.inf
        return float(away.min())


def apart_m(a: Array, b: Array) -> float:
    return float(cKDTree(a).query(b)[0].min()) if len(a) and len(b) else np.inf


def through_m(a: Array, b: Array) -> float:
    """How far two curves in the plane that cross reach beyond each other, by the sides of their points.

    The last points of ``a`` that are on another side of ``b`` than those before are beyond it.
    """

    def beyond(p: Array, q: Array) -> float:
        reach = 0.0
        # A crossing: consecutive points of p on two sides of consecutive points of q, and the reverse.
        side_p = _side(q[:-1], q[1:], p)  # (points of p, pieces of q)
        side_q = _side(p[:-1], p[1:], q)
        crosses = (side_p[:-1] * side_p[1:] <= 0.0) & (side_q[:-1] * side_q[1:] <= 0.0).T
        for k in np.nonzero(crosses.any(axis=1))[0][:1]:
            reach = float(cKDTree(q).query(p[k + 1 :])[0].max())
        return reach

    a, b = a[:, :2], b[:, :2]
    return min(beyond(a, b), beyond(b, a))


def _side(start: Array, end: Array, points: Array) -> Array:
    u, r = end - start, points[:, None] - start[None]
    return np.asarray(u[None, :, 0] * r[..., 1] - u[None, :, 1] * r[..., 0])


def accepted(guard: ClearanceGuard, at: dict[str, tuple[Actuation, Any]]) -> bool:
    shapes = Shapes(guard, at)
    found = [*map(shapes.nearest, guard.pairs), *map(shapes.sampled, guard.sampled)]
    return all(each.spare_m >= 0.0 for each in found)


def compare(guard: ClearanceGuard, count: int, seed: int) -> dict[str, int]:
    """Count accepted pairs, those that touch, and those that dense samples find too near."""
    (one, two), rng = guard.arms, np.random.default_rng(seed)
    seen = {"accepted": 0, "touching": 0, "wrong": 0, "refused clear": 0}
    for _ in range(count):
        first = _drawn(guard, one, rng)
        at = {one: (first, ZERO3), two: (_beside(guard, (one, two), first, rng), ZERO3)}
        a, b = (Dense(guard, name, at[name][0]) for name in (one, two))
        radius_m, tip_m = guard.arms[one].radius_m, guard.arms[one].tip_radius_m
        shafts = min(apart_m(a.points, b.parts(free=False)), apart_m(a.parts(free=False), b.points))
        tips = apart_m(a.parts(free=True), b.parts(free=True))
        across = 0.0
        if guard.arms[one].model.dimension == 2 and tips < 1e-3:
            across = through_m(a.parts(free=True), b.parts(free=True))
        own = min(each.own_m(1.2 * np.pi * (radius_m + 0.5 * guard.margin_m)) for each in (a, b))
        spare = min(
            shafts - 2.0 * radius_m - guard.margin_m,
            own - 2.0 * radius_m - guard.margin_m,
            (tips if across == 0.0 else -across) - 2.0 * tip_m + guard.tip_depth_m,
        )
        yes = accepted(guard, at)
        seen["accepted"] += yes
        seen["touching"] += yes and tips < 2.0 * tip_m + 2e-3
        seen["wrong"] += yes and spare < -1e-4
        seen["refused clear"] += not yes and spare > 3e-4
    return seen


def _drawn(guard: ClearanceGuard, name: str, rng: np.random.Generator) -> Actuation:
    model, rest = guard.arms[name].model, np.array(guard.rest[name])
    low, high = np.array(model.lower), np.array(model.upper)
    drawn = low + (high - low) * rng.random(len(low))
    return tuple((rest + rng.random() * (drawn - rest)).tolist())


def _beside(
    guard: ClearanceGuard, names: tuple[str, str], first: Actuation, rng: np.random.Generator
) -> Actuation:
    """Every other time with the tip near that of the first arm, where it gets there; else at random."""
    one, two = (guard.arms[name] for name in names)
    drawn = _drawn(guard, names[1], rng)
    if rng.random() < 0.5:
        return drawn
    flat = one.model.dimension == 2
    off = rng.normal(0.0, 3e-3, 3) * ([1, 1, 0] if flat else 1)
    tip = np.array(one.frame.point_in_world(one.model.forward(first).tip_m)) + off
    found = two.model.inverse(
        two.frame.target_in_base(Target(tip_m=vec3(tip.tolist()))), guard.rest[names[1]]
    )
    return found.actuation if found.converged else drawn


@pytest.mark.slow
@pytest.mark.parametrize("tip_radius_mm", [0, pytest.param(3, marks=pytest.mark.campaign), 7])
def test_no_pair_of_fingers_is_accepted_inside_each_other(tip_radius_mm: float) -> None:
    seen = compare(hand(tip_radius_mm=tip_radius_mm), 100, 7)
    assert seen["wrong"] == 0, seen
    assert seen["accepted"] > 16, seen
    assert seen["touching"] > (2 if tip_radius_mm == 0 else -1), seen
    assert seen["refused clear"] < 5, seen


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "apart_mm"),
    [
        pytest.param("tendon3", 120.0, marks=pytest.mark.campaign),
        ("trirack2", 150.0),
        pytest.param("ftdcr_v4", 80.0, marks=pytest.mark.campaign),
    ],
)
def test_no_pair_of_arms_is_accepted_inside_each_other_or_itself(name: str, apart_mm: float) -> None:
    guard = arms(name, apart_mm, {"radius_mm": 9, "tip_free_mm": 15, "tip_radius_mm": 4})
    seen = compare(guard, 60, 8)
    assert seen["wrong"] == 0, seen
    assert seen["accepted"] > 6, seen


def test_a_finger_that_folds_on_itself_is_refused_and_one_that_bends_is_not() -> None:
    guard = hand()
    walk = Walk(guard, {name: (guard.rest[name], ZERO3) for name in guard.arms})
    assert walk.to({"left": ((0.08, 0.04), ZERO3)}) == ""
    refused = walk.to({"left": ((0.099, 0.001), ZERO3)})
    assert "of itself; clearance.margin_mm is 2" in refused or "runs into itself" in refused


def test_a_finger_too_short_to_meet_itself_is_refused_when_it_gets_long_enough_to() -> None:
    """Its body is 24 mm long at first, where points that may not meet are 29 mm apart along it."""
    guard, before = hand(), hand()
    before.ask_as_before()
    start, folded = np.array([0.002, 0.002]), np.array([0.001, 0.099])
    walk = Walk(guard, {name: (tuple(start.tolist()), ZERO3) for name in guard.arms})
    ways = [tuple((start + k / 100 * (folded - start)).tolist()) for k in range(1, 101)]
    refused = [message for way in ways if (message := walk.to({"left": (way, ZERO3)}))]
    assert "of itself; clearance.margin_mm is 2" in refused[0]
    reached, _ = walk.configuration["left"]
    assert Dense(guard, "left", reached).own_m(1.2 * np.pi * 8e-3) > 14e-3
    walk = Walk(before, {name: (tuple(start.tolist()), ZERO3) for name in guard.arms})
    assert not any(walk.to({"left": (way, ZERO3)}) for way in ways)


def test_fingers_that_cross_are_refused_where_tips_at_one_point_are_not() -> None:
    guard = guard_of(find_robot_file("hand").read_text(encoding="utf-8"))
    tips = {name: guard.arms[name].model for name in guard.arms}

    def at(left_mm: tuple[float, float], right_mm: tuple[float, float]) -> dict[str, tuple[Actuation, Any]]:
        found = {}
        for name, (x, y) in (("left", left_mm), ("right", right_mm)):
            goal = guard.arms[name].frame.target_in_base(Target(tip_m=(x / 1e3, y / 1e3, 0.0)))
            found[name] = (tips[name].inverse(goal, guard.rest[name]).actuation, ZERO3)
        return found

    walk = Walk(guard, at((30, 80), (70, 80)))
    assert walk.to(at((50, 70), (50, 70))) == ""
    refused = walk.to(at((60, 70), (40, 70)))
    assert "into the tip of right; clearance.tip_depth_mm is 0.5" in refused
