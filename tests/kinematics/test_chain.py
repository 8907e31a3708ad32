"""The guard of a closed chain, and its keys in a robot file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from contid.errors import BadInputError
from contid.robot_file.chain import Chain
from contid.robot_file.load import load_robot_file, parse_robot_file
from contid.targets import Tip
from contid_ropes.chain import ChainGuard
from tests.kinematics.ph_golden import GOLDEN, MM, two_section_pose

CHAIN = Path(__file__).parents[2] / "configs" / "chain.yaml"


def guard(floor_mm: float = -150.0, **rope: object) -> ChainGuard:
    links = [{"arm": "a"}, {"rope": {"length_mm": 1000, **rope}}, {"arm": "b"}]
    return ChainGuard("rope", Chain.model_validate({"model": "chain", "links": links, "floor_mm": floor_mm}))


def tips(span_m: float = 0.7, height_m: float = 0.24, rise_m: float = 0.0) -> dict[str, Tip]:
    up = (0.0, 0.0, 1.0)
    return {"a": ((0.0, 0.0, height_m), up), "b": ((span_m, 0.0, height_m + rise_m), up)}


def golden_tips() -> dict[str, Tip]:
    golden, poses = GOLDEN["chain_rope"], {}
    for arm, key, base in (("a", "l_1", [0, 0, 0]), ("b", "l_2", golden["base2"])):
        tip, tangent, _ = two_section_pose(np.array(golden[key]) * MM)
        poses[arm] = (tuple((tip + np.array(base) * MM).tolist()), tuple(tangent.tolist()))
    return poses


def test_the_golden_chain_is_feasible_and_its_rope_the_golden_curve() -> None:
    state = guard(mass_g=50).check(golden_tips())
    assert state.feasible
    (fit,) = guard().curves(golden_tips())
    np.testing.assert_allclose(fit.curve.control_points_m / MM, GOLDEN["chain_rope"]["CP"], rtol=0, atol=1e-9)
    assert state.lowest is not None
    assert state.lowest[2] == pytest.approx(np.min(fit.curve.evenly(2001)[:, 2]), abs=5e-5)
    assert state.pull_n is not None
    assert 0.25 < sum(state.pull_n) < 1.0


@pytest.mark.parametrize("pieces", [1, 2])
def test_a_clamped_rope_hangs_as_low_as_it_is_drawn(pieces: int) -> None:
    rope = guard(ends="clamped", pieces=pieces)
    for poses in (golden_tips(), tips(), tips(0.8, rise_m=0.05), tips(0.5, rise_m=-0.1)):
        drawn = np.concatenate([fit.curve.point(np.linspace(0.0, 1.0, 129)) for fit in rope.curves(poses)])
        assert rope.check(poses).lowest == pytest.approx(drawn[np.argmin(drawn[:, 2])], abs=1e-12)


def test_a_rope_too_short_reports_the_missing_length() -> None:
    state = guard().check(tips(1.0125))
    assert not state.feasible
    assert state.reason == "the rope is 12.5 mm too short between a and b"
    assert state.lowest is None
    assert len(guard().points(tips(1.0125), 5)) == 0


def test_the_floor_decides_at_the_lowest_point() -> None:
    lowest = guard().check(tips()).lowest
    assert lowest is not None
    lowest_mm = lowest[2] / MM
    assert -90.0 < lowest_mm < -60.0
    assert guard(floor_mm=lowest_mm - 0.01).check(tips()).feasible
    refused = guard(floor_mm=lowest_mm + 0.01).check(tips())
    assert not refused.feasible
    assert "0.01 mm below its floor" in refused.reason


@pytest.mark.parametrize("ends", ["pinned", "clamped"])
@pytest.mark.parametrize("pieces", [1, 2])
def test_every_kind_of_rope_has_its_length_and_its_ends(ends: str, pieces: int) -> None:
    watched, at = guard(ends=ends, pieces=pieces), golden_tips()
    fits = watched.curves(at)
    assert len(fits) == pieces
    assert all(fit.length_met for fit in fits)
    assert sum(fit.curve.length_m for fit in fits) == pytest.approx(1.0, abs=1e-12)
    points = watched.points(at, 41)
    assert points.shape == (41, 3)
    np.testing.assert_allclose(points[[0, -1]], [at["a"][0], at["b"][0]], atol=1e-12)
    if ends == "clamped":
        assert fits[0].curve.tangent(np.zeros(1))[0] == pytest.approx(at["a"][1])
        assert fits[-1].curve.tangent(np.ones(1))[0] == pytest.approx([-v for v in at["b"][1]])
    if pieces == 2:
        joint = [fits[0].curve.tangent(np.ones(1))[0], fits[1].curve.tangent(np.zeros(1))[0]]
        assert joint[0] == pytest.approx(joint[1], abs=1e-12)


def test_two_pieces_of_a_pinned_rope_stay_with_the_catenary() -> None:
    one, two = guard().points(tips(0.8), 101), guard(pieces=2).points(tips(0.8), 101)
    assert np.max(np.linalg.norm(one - two, axis=1)) < 5e-4


def test_the_shipped_chain_watches_its_arms() -> None:
    robots = load_robot_file(CHAIN).file.robots
    chain = robots["rope"]
    assert isinstance(chain, Chain)
    assert chain.passive
    assert chain.arms == ("left", "right")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("- arm: right", "- arm: rigth", "no robot 'rigth'; allowed: left, right"),
        ("- arm: right", "- arm: left", "'left' is the first arm already"),
        ("- arm: right", "- arm: rope", "'rope' has no actuators"),
        ("- arm: right", "- {}", "a link is either an arm or a rope"),
        ("- arm: right", "- rope: {length_mm: 3}", "links are arm, rope, rope"),
        ("floor_mm: -150", "floor: -150", "floor_mm"),
        ("length_mm: 1000", "length_mm: -1", "length_mm"),
        ("floor_mm: -150", "floor_mm: -150\n    rates: {velocity_mm_s: 1}", "rates has no meaning here"),
        (
            "floor_mm: -150",
            "floor_mm: -150\n    axes: {x: {bus: left_hand, channel: p1}}",
            "a passive robot has no axes",
        ),
    ],
)
def test_mistakes_in_a_chain_are_located(old: str, new: str, message: str) -> None:
    text = CHAIN.read_text()
    assert old in text
    changed = text.replace(old, new)
    with pytest.raises(BadInputError) as caught:
        parse_robot_file(changed, "chain.yaml")
    found = [each for each in caught.value.findings if message in each.message]
    assert found, str(caught.value)
    chain = changed[: changed.index("model: chain")].count("\n")
    assert all(chain <= each.line <= changed.count("\n") + 1 for each in found)
