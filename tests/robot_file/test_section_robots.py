"""Robot files of tri-rack and tube arms."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from pydantic import ValidationError

from contid.errors import BadInputError
from contid.robot_file.load import parse_robot_file
from contid.robot_file.tri_rack import TriRack
from contid.robot_file.tri_tube import TriTube


@pytest.fixture
def cbha(configs):
    return yaml.safe_load((configs / "cbha.yaml").read_text())["robots"]["cbha"]


@pytest.fixture
def trirack2(configs):
    return yaml.safe_load((configs / "trirack2.yaml").read_text())["robots"]["arm"]


def test_axes_are_named_by_section_and_tube(cbha):
    robot = TriTube.model_validate(cbha)
    assert robot.axis_names == ("s1.l1", "s1.l2", "s1.l3", "s2.l1", "s2.l2", "s2.l3")
    assert robot.extra_axis_names == ("wrist", "gripper")
    assert robot.extra_limits == {"wrist": (0.0, 0.02), "gripper": (0.0, 0.01)}
    assert robot.lower == (0.1,) * 3 + (0.09,) * 3
    assert robot.radius_m == (0.04, 0.032)
    assert robot.coupling is None
    assert {"tip", "direction", "rotation", "mid", "actuation", "arcs"} == robot.accepts


def test_layouts_of_tubes(cbha):
    assert TriTube.model_validate(cbha).tube_angles_deg == ((180.0, 60.0, -60.0),) * 2
    cbha["geometry"]["layout"] = "ccw"
    assert TriTube.model_validate(cbha).tube_angles_deg[0] == (0.0, 120.0, 240.0)
    cbha["geometry"]["angles_deg"] = [10, 130, 250]
    assert TriTube.model_validate(cbha).tube_angles_deg[1] == (10.0, 130.0, 250.0)


@pytest.mark.parametrize("angles_deg", [[10, 370, 250], [0, 0.5, 120], [0, 359.5, 120], [120, 119.99, 0]])
def test_tubes_at_one_azimuth_are_refused_in_either_sense(cbha, angles_deg):
    cbha["geometry"]["angles_deg"] = angles_deg
    with pytest.raises(ValidationError, match="degrees apart; allowed: three different azimuths"):
        TriTube.model_validate(cbha)


@pytest.mark.parametrize(("key", "value"), [("radius_mm", [40, 32, 20]), ("rigid_mm", [1, 2, 3])])
def test_numbers_per_section_are_one_or_all(cbha, key, value):
    cbha["geometry"][key] = value
    with pytest.raises(ValidationError, match="allowed: 1 or 2"):
        TriTube.model_validate(cbha)


def test_conventions_of_racks_are_mirror_images(trirack2):
    clockwise = TriRack.model_validate(trirack2)
    trirack2["geometry"]["convention"] = "counterclockwise"
    other = TriRack.model_validate(trirack2)
    for a, b in zip(clockwise.tube_angles_deg[0], other.tube_angles_deg[0], strict=True):
        assert math.cos(math.radians(a)) == pytest.approx(math.cos(math.radians(b)))
        assert math.sin(math.radians(a)) == pytest.approx(-math.sin(math.radians(b)))


def test_racks_must_reach_the_retracted_arm(trirack2):
    trirack2["limits"]["rack_length_mm"] = 20
    with pytest.raises(ValidationError, match="retracted"):
        TriRack.model_validate(trirack2)


def test_lengths_are_not_negative(trirack2):
    trirack2["limits"]["length_mm"] = [[-1, 650], [10, 650]]
    with pytest.raises(ValidationError, match="not negative"):
        TriRack.model_validate(trirack2)


def test_single_segments_take_no_direction(configs):
    raw = yaml.safe_load((configs / "trirack.yaml").read_text())["robots"]["arm"]
    robot = TriRack.model_validate(raw)
    assert robot.accepts == {"tip", "actuation", "arcs"}
    assert robot.coupling is None
    assert robot.rack_m == math.inf


def test_the_mean_radius_of_a_taper_gives_the_offset_tubes_length():
    """Integrate a tube beside an arc while it tapers; the slope lengthens all tubes nearly alike."""
    start, end, theta, length = 0.044, 0.036, 0.9, 0.125
    s = (np.arange(20_000) + 0.5) / 20_000
    inner = np.hypot(length - (start + (end - start) * s) * theta, end - start).mean()
    straight = math.hypot(length, end - start)
    assert inner - straight == pytest.approx(-0.5 * (start + end) * theta, rel=4e-3)


@pytest.mark.parametrize(
    ("rest", "racks_mm", "message"),
    [
        (
            "rest_mm: [600, 600, 600, 600, 600, 600]",
            790,
            r":37:14: rest_mm: a rack has 1200 mm .* at most .*790",
        ),
        (
            "rest_mm: [100, 100, 400, 10, 10, 10]",
            790,
            r":37:14: rest_mm: section 1 .* radius of 35 mm; .* 120",
        ),
        ("", 400, r":16:3: rest_mm is missing; half-way .* a rack has 660 mm .* at most rack_length_mm, 400"),
    ],
)
def test_a_rest_pose_outside_limits_that_lengths_share_is_refused(
    configs: Path, rest: str, racks_mm: int, message: str
) -> None:
    """Its axes never come to rest there, and a stop of policy rest never ended."""
    text = (
        (configs / "trirack2.yaml").read_text().replace("rack_length_mm: 790", f"rack_length_mm: {racks_mm}")
    )
    text = text.replace("rest_mm: [10, 10, 10, 10, 10, 10]", rest)
    with pytest.raises(BadInputError, match=message):
        parse_robot_file(text, "arm.yaml")
    assert parse_robot_file(text, "arm.yaml", recorded=True), "what was recorded is replayed"
