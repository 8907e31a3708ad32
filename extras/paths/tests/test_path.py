"""``contid path``: columns for the robots it is for, and usage that is refused."""

from __future__ import annotations

import io
import math
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from contid.control.daemon.check_trajectory import check_trajectory
from contid.errors import ContidError
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import build_model
from contid.robot_file.load import load_named, load_robot_file
from contid.trajectory.read import read_trajectory
from contid_paths import about_rest
from contid_paths.command import command


def path(*arguments: str) -> str:
    done = CliRunner().invoke(command, arguments)
    assert done.exit_code == 0, done.output
    return done.stdout


def test_the_circle_of_the_paper_for_both_fingers(configs: Path) -> None:
    text = path("circle", "--center", "50,70", "--radius", "20", "--period", "4", "--for", "hand")
    robots = load_robot_file(configs / "hand.yaml").file.robots
    trajectory = read_trajectory(io.StringIO(text), "stdin", robots)
    assert (trajectory.start_s, trajectory.end_s) == (0.0, 4.0)
    targets = trajectory.targets_at(1.0)
    assert targets["left"].tip_m == targets["right"].tip_m == (0.05, 0.09, 0.0)


@pytest.mark.parametrize("moved", [("--center", "50,500"), ("--angle", "30")])
def test_a_swing_is_about_its_bases(moved: tuple[str, str]) -> None:
    done = CliRunner().invoke(command, ("swing", "--for", "chain", *moved))
    assert done.exit_code == 2
    assert "swing takes --for" in done.output


def test_a_single_robot_needs_no_name() -> None:
    assert path("line", "--size", "80", "--rate", "1").startswith("t_s,x_mm,y_mm\n")
    assert path("line", "--size", "80", "--for", "finger").startswith("t_s,x_mm,y_mm\n")
    named = path("line", "--size", "80", "--robots", "a, b")
    assert named.startswith("t_s,a.x_mm,a.y_mm,b.x_mm,b.y_mm\n")


def test_spatial_paths_with_direction_and_mid_point() -> None:
    text = path(
        *("spiral", "--radius", "30", "--height", "120", "--lean", "45", "--rate", "10"),
        *("--mid", "0,0,60", "--for", "stiffflop2"),
    )
    header, first, *_ = text.splitlines()
    assert header == "t_s,x_mm,y_mm,z_mm,ax,ay,az,mid.x_mm,mid.y_mm,mid.z_mm"
    assert first.endswith(",0.0,0.0,60.0")
    moving = path("circle", "--radius", "30", "--center", "0,0,116", "--mid", "square:20:60", "--rate", "10")
    assert moving.splitlines()[1] == "0.0,30.0,0.0,116.0,10.0,-10.0,60.0"
    assert path("box", "--size", "20", "--height", "50", "--rate", "2").splitlines()[5].endswith(",60.0")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["circle"], "--size or --radius"),
        (["circle", "--for", "finger", "--height", "20"], "--size or --radius"),
        (["circle", "--size", "1", "--radius", "1"], "not both"),
        (["square", "--radius", "1"], "has no radius"),
        (["circle", "--radius", "1", "--center", "1"], "'--center': '1' is not 2 to 3 numbers"),
        (["circle", "--radius", "1", "--center", "1,nan"], "'--center': 'nan' is not a finite number"),
        (["circle", "--radius", "-5"], "'--radius': -5.0 is not in the range x>0"),
        (["circle", "--radius", "inf"], "'--radius': 'inf' is not a finite number"),
        (["circle", "--radius", "1", "--period", "0"], "'--period': 0.0 is not in the range x>0"),
        (["circle", "--radius", "1", "--height", "nan"], "'--height': 'nan' is not a finite number"),
        (["circle", "--radius", "1", "--height", "1", "--mid", "circle:-3:4"], "'--mid': -3.0 is not in"),
        (["circle", "--radius", "1", "--height", "1", "--mid", "1,2"], "'--mid': '1,2' is not 3 numbers"),
        (["circle", "--radius", "1", "--for", "stiffflop2"], "needs --height"),
        (["circle", "--radius", "1", "--lean", "3"], "needs --height"),
        (["circle", "--radius", "1", "--center", "1,2,3", "--height", "3"], "one of them"),
        (["circle", "--radius", "1", "--height", "1", "--mid", "what:1:2"], "neither x,y,z"),
        (["cirle"], "cirle"),
    ],
)
def test_usage_that_is_refused(arguments: list[str], expected: str) -> None:
    done = CliRunner().invoke(command, arguments)
    assert done.exit_code == 2
    assert expected in done.output


def test_a_path_may_be_for_one_robot_of_a_file() -> None:
    printed = (
        CliRunner().invoke(command, ["circle", "--radius", "1", "--for", "hand", "--robots", "left"]).output
    )
    assert printed.startswith("t_s,left.x_mm,left.y_mm\n")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--for", "hnd"], "did you mean 'hand'"),
        (["--for", "hand", "--robots", "up"], "no robot 'up' takes a tip position; allowed: left, right"),
        (["--for", "hand", "--height", "1", "--lean", "3"], "left takes no direction"),
        (["--for", "hand", "--height", "1", "--mid", "1,2,3"], "left takes no mid"),
    ],
)
def test_robots_that_cannot_follow(arguments: list[str], expected: str) -> None:
    done = CliRunner().invoke(command, ["circle", "--radius", "1", *arguments])
    assert expected in str(done.exception)


def test_more_rows_than_a_trajectory_may_have_are_refused() -> None:
    with pytest.raises(ContidError, match=r"4e\+06 rows; allowed are 2000000"):
        CliRunner().invoke(command, ["circle", "--radius", "20", "--rate", "1e6"], catch_exceptions=False)


@pytest.mark.parametrize(
    ("shape", "name"),
    [
        pytest.param("circle", "hand", marks=pytest.mark.slow),
        ("line", "trirack"),
        ("circle", "cbha"),
        pytest.param("square", "stiffflop1", marks=pytest.mark.slow),
        pytest.param("line", "tendon3", marks=pytest.mark.slow),
    ],
)
def test_a_path_without_size_and_place_is_one_that_the_robot_follows_about_its_rest_pose(
    shape: str, name: str, tmp_path: Path
) -> None:
    done = CliRunner().invoke(command, [shape, "--for", name])
    assert done.exit_code == 0, done.output
    assert re.match(rf"contid: {shape} of [\d.]+ mm about .* mm, [\d.]+ s a lap", done.stderr)
    (tmp_path / "path.csv").write_text(done.stdout)
    assert "within reach and limits" in str(check_trajectory(name, str(tmp_path / "path.csv")))
    for robot in load_named(name).driven.values():
        model, frame = build_model(robot), BaseFrame.of(robot.base)
        rest = frame.point_in_world(model.forward(robot.rest[: len(model.axis_names)]).tip_m)
        trajectory = read_trajectory(io.StringIO(done.stdout), "path", load_named(name).driven)
        tips = [targets.tip_m for targets in trajectory.targets_of_row(0).values() if targets.tip_m]
        assert min(math.dist(tip, rest) for tip in tips) < 2.0 * math.dist(rest, frame.origin_in_world)


def test_a_shape_that_is_nowhere_within_reach_asks_for_its_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(about_rest, "_SIZES", 1)
    monkeypatch.setattr(about_rest, "_CENTRES", 1)
    done = CliRunner().invoke(command, ["circle", "--for", "trirack2", "--lean", "170"])
    assert "give --size and --height" in str(done.exception)


@pytest.mark.parametrize("place", [("--center", "20,80,50"), ("--center", "20,80", "--height", "50")])
def test_a_height_of_planar_robots_is_refused(place: tuple[str, ...]) -> None:
    """It was left out without a word; 0 is where they are."""
    done = CliRunner().invoke(command, ("circle", *place, "--radius", "10", "--for", "finger"))
    assert done.exit_code == 2
    assert "the robots of finger are planar: they have no z" in done.output
    assert path("circle", "--center", "20,80,0", "--radius", "10", "--for", "finger").startswith(
        "t_s,x_mm,y_mm\n"
    )
