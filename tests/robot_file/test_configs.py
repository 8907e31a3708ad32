"""The shipped finger and hand do what the paper shows, inside their own limits and rates."""

from __future__ import annotations

import itertools
from pathlib import Path as File

import pytest

from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import build_model
from contid.robot_file.load import load_robot_file
from contid.targets import Target
from contid.units import m_to_mm, mm_to_m
from contid_paths.shapes import Shape, ShapePath

RATE_HZ = 50.0
CIRCLE = ShapePath(Shape.CIRCLE, (50.0, 70.0), 40.0, rate_hz=RATE_HZ)
LINE = ShapePath(Shape.LINE, (50.0, 60.0), 80.0, angle_deg=90.0, rate_hz=RATE_HZ)


@pytest.mark.parametrize("robot", ["left", "right"])
@pytest.mark.parametrize(
    ("path", "longest_mm"),
    # Part A of the reference: with correction, h = 22 mm and w = 13 mm.
    [(CIRCLE, 99.58142255), (LINE, 99.46433363)],
    ids=["circle", "line"],
)
def test_both_fingers_reach_the_paths_of_the_paper(
    configs: File, robot: str, path: ShapePath, longest_mm: float
) -> None:
    description = load_robot_file(configs / "hand.yaml").file.robots[robot]
    model, frame = build_model(description), BaseFrame.of(description.base)
    seed, racks = description.rest, []
    for time_s in path.times():
        x_mm, y_mm, _ = path.point_mm(time_s)
        target = Target(tip_m=frame.point_in_base((mm_to_m(x_mm), mm_to_m(y_mm), 0.0)))
        solution = model.inverse(target, seed)
        assert solution.converged, solution
        seed = solution.actuation
        racks.append(seed)
    assert m_to_mm(max(map(max, racks))) == pytest.approx(longest_mm, abs=5e-3)
    steps = [abs(b - a) for one, two in itertools.pairwise(racks) for a, b in zip(one, two, strict=True)]
    assert max(steps) * RATE_HZ < description.rate_limits[0][0]
