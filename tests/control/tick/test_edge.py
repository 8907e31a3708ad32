"""Steps of tips and bends from rest: in reach, led along its edge, or out of it with nothing beside them."""

from __future__ import annotations

import math

import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.preflight.edge import along_the_edge, off_the_reach_m
from contid.control.tick.preflight.rows import Preflight
from contid.kinematics.model import Bending
from contid.robot_file.load import load_named, parse_robot_file
from contid.targets import Actuation, Target, Vec3

STEP_M = 1.5e-3
STEPS = 8
#: Ways along which the straight arm of a robot ends: it has no longer or no shorter pose.
BLOCKED = {
    "trirack": {(2, -1)},
    "trirack2": {(2, -1)},
    "cbha": {(2, -1)},
    "stiffflop1": {(2, -1)},
    "tendon3": {(2, 1)},
    "ftdcr_v4": {(2, 1)},
}


def config_of(name: str) -> RobotConfig:
    return build_robot_configs(load_named(name), 100.0)[0]


def taken(config: RobotConfig, target: Target, begin: Target, seed: Actuation) -> Target | None:
    """The target, or what is taken in its place."""

    def refused(each: Target) -> bool:
        return bool(Preflight((config,), seeds={config.name: seed}).row({config.name: each}))

    if not refused(target):
        return target
    edge = along_the_edge(config, target, begin, seed)
    assert edge is None or not refused(edge)
    return edge


def walked(config: RobotConfig, axis: int, sign: int) -> tuple[Vec3, Vec3] | None:
    """Begin and end of steps of the tip from rest; None where the first is refused."""
    seed = config.rest
    begin = tip = config.frame.point_in_world(config.model.forward(seed).tip_m)
    for _ in range(STEPS):
        moved = tuple(value + sign * STEP_M * (k == axis) for k, value in enumerate(tip))
        here = Target(tip_m=tip)
        found = taken(config, Target(tip_m=(moved[0], moved[1], moved[2])), here, seed)
        if found is None or found.tip_m is None:
            return None
        assert math.dist(found.tip_m, tip) < 2.0 * STEP_M
        tip = found.tip_m
        seed = config.model.inverse(config.frame.target_in_base(found), seed).actuation
    return begin, tip


@pytest.mark.parametrize(
    "name", ["finger", "trirack", "trirack2", "cbha", "stiffflop1", "tendon3", "ftdcr_v4"]
)
def test_tips_move_from_rest_every_way_that_is_free(name: str) -> None:
    config = config_of(name)
    ways = [(axis, sign) for axis in range(config.model.dimension) for sign in (1, -1)]
    ends = {way: walked(config, *way) for way in ways}
    assert {way for way, end in ends.items() if end is None} == BLOCKED.get(name, set())
    for (axis, sign), end in ends.items():
        if end is not None:
            assert sign * (end[1][axis] - end[0][axis]) > 0.25 * STEPS * STEP_M


@pytest.mark.parametrize("name", ["finger", "trirack", "trirack2", "cbha", "tendon3", "ftdcr_v4"])
def test_every_bend_grows_from_rest_and_lengths_yield_where_they_must(name: str) -> None:
    config = config_of(name)
    model, rest = config.model, config.rest
    assert isinstance(model, Bending)
    start = model.arcs(rest).ravel().tolist()
    for section in range(len(start) // 3):
        seed, shape = rest, list(start)
        for k in range(1, 6):
            asked = list(shape)
            asked[3 * section] = start[3 * section] + math.radians(1.0) * k
            target = taken(config, Target(arcs=tuple(asked)), Target(arcs=tuple(shape)), seed)
            assert target is not None
            assert target.arcs is not None
            for place, value in enumerate(target.arcs):
                if place % 3 < 2:
                    assert value == asked[place]
            shape = list(target.arcs)
            seed = model.inverse(target, seed).actuation
        assert model.arcs(seed)[section, 0] == pytest.approx(start[3 * section] + math.radians(5.0))


def test_a_length_at_its_limit_is_refused_and_one_beyond_it_goes_there() -> None:
    config = config_of("trirack")
    rest = config.rest
    start = (0.0, 0.0, 0.05)
    shorter = Target(arcs=(0.0, 0.0, 0.049))
    assert along_the_edge(config, shorter, Target(arcs=start), rest) is None
    inside = Target(arcs=(0.2, 0.0, 0.0565))
    beyond = Target(arcs=(0.2, 0.0, 0.052))
    found = along_the_edge(config, beyond, inside, rest)
    assert found is not None
    assert found.arcs is not None
    lengths = config.model.inverse(found, rest).actuation
    assert min(lengths) == pytest.approx(0.05, abs=1e-9)
    assert along_the_edge(config, Target(arcs=(0.2, 0.0, 0.02)), inside, rest) is None  # no step


def test_what_is_far_away_is_no_step() -> None:
    config = config_of("finger")
    tip = config.model.forward(config.rest).tip_m
    assert along_the_edge(config, Target(tip_m=(5.0, 0.075, 0.0)), Target(tip_m=tip), config.rest) is None


def test_a_direction_is_not_led_along_the_edge() -> None:
    config = config_of("trirack2")
    tip = config.model.forward(config.rest).tip_m
    below = Target(tip_m=(0.001, 0.0, tip[2] - 0.002), direction=(0.0, 0.0, 1.0))
    assert along_the_edge(config, below, Target(tip_m=tip), config.rest) is None


def test_an_azimuth_of_an_arm_that_bends_in_a_plane_leads_nowhere() -> None:
    loaded = load_named("planar2")
    (config,) = build_robot_configs(loaded, loaded.file.rate_hz)
    bend, turn = math.radians(0.03), math.radians(0.1)
    begin = Target(arcs=(bend, 0.0, 0.1, 0.0, 0.0, 0.1))
    seed = config.model.inverse(begin, config.rest).actuation
    asked = Target(arcs=(bend * math.cos(turn), bend * math.sin(turn), 0.1, 0.0, 0.0, 0.1))
    assert config.model.inverse(asked, seed).converged
    assert off_the_reach_m(config, asked, begin, seed) > 0.0
    assert along_the_edge(config, asked, begin, seed) is None
    longer = Target(arcs=(1.5 * bend, 0.0, 0.1, 0.0, 0.0, 0.1))
    assert off_the_reach_m(config, longer, begin, seed) == 0.0


def test_bends_under_a_load_do_not_depend_on_how_the_base_is_turned() -> None:
    """The load of a target is in the world, and the model takes it in the base frame."""
    text = load_named("stiffflop1").text
    answers = []
    for yaw_deg in (0, 90):
        turned = text.replace("model: cosserat", f"model: cosserat\n    base: {{yaw_deg: {yaw_deg}}}", 1)
        config = build_robot_configs(parse_robot_file(turned, "arm.yaml"), 100.0)[0]
        model, load_n = config.model, (0.3, 0.0, 0.0)
        assert isinstance(model, Bending)
        low, high = model.lower, model.upper
        seed = tuple(a + part * (b - a) for a, b, part in zip(low, high, (0.5, 0.3, 0.5), strict=True))
        begin = tuple(model.arcs(seed, load_n).ravel().tolist())
        asked = (begin[0] + 0.01, *begin[1:])
        here, there = (
            Target(arcs=arcs, load_n=config.frame.vector_in_world(load_n)) for arcs in (begin, asked)
        )
        found = along_the_edge(config, there, here, seed)
        assert found is not None
        assert off_the_reach_m(config, there, here, seed) == 0.0
        answers.append(found.arcs)
    assert answers[0] == pytest.approx(answers[1], abs=1e-9)
