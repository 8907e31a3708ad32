"""`contid modes --save`: every mode swings in the file, by so much and as fast as it should."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from contid.robot_file.load import load_named
from contid_dynamics.swing import AMPLITUDE, SwingingPose
from contid_view.rerun.swings import draw_swings
from tests.support.rerun_entities import entities


def test_a_drawn_mode_keeps_the_length_of_the_rod_and_moves_along_its_shape() -> None:
    (robot,) = load_named("bend1").driven.values()
    pose = SwingingPose(robot, robot.rest, 2)
    still, there, back = (pose.line_m(0, share) for share in (0.0, 1.0, -1.0))
    whole, bent = (float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in (still, there))
    assert bent == pytest.approx(whole, rel=2e-3)
    assert np.linalg.norm(there - still, axis=1).max() == pytest.approx(AMPLITUDE * whole, rel=0.1)
    shape = np.array(pose.modes.modes[0].shape_mm)
    moved = (there - back)[:-1]
    cosine = float((moved * shape).sum() / np.linalg.norm(moved) / np.linalg.norm(shape))
    assert abs(cosine) > 0.99
    assert np.array_equal(pose.line_m(0, 0.0), still)


@pytest.mark.process
def test_every_mode_is_in_the_file_for_three_of_its_periods(tmp_path: Path) -> None:
    loaded = load_named("bend1")
    (name,) = loaded.driven
    robot = loaded.driven[name]
    pose = SwingingPose(robot, robot.rest, 2)
    draw_swings(loaded, {name: pose}, tmp_path / "modes.rrd")
    there = entities(tmp_path / "modes.rrd")
    slowest = min(mode.frequency_hz for mode in pose.modes.modes)
    for k in (1, 2):
        frames = there[f"robots/{name}/mode_{k}/body"]
        assert frames >= 30.0 * min(12.0, max(3.0, 3.0 / slowest))
        assert f"robots/{name}/mode_{k}/rest" in there
