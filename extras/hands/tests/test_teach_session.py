"""What a session of teaching takes, without a daemon."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from contid.client import Client
from contid.errors import ContidError
from contid_hands.teach.session import TeachSession


def described(folder: Path) -> dict[str, Any]:
    robot = {
        "unit": "mm", "columns": ["x_mm", "y_mm"], "stop": {"estop": "relax"},
        "velocity_mm_s": 60.0, "acceleration_mm_s2": 1000.0, "jerk_mm_s3": 20000.0,
        "axes": {axis: {"min_mm": 30.0, "max_mm": 100.0} for axis in ("left", "right")},
    }  # fmt: skip
    return {"file": str(folder / "hand.yaml"), "robots": {"f0": robot, "f1": robot}}


def session(folder: Path, *names: str) -> TeachSession:
    client = cast(Client, SimpleNamespace(describe=lambda: described(folder)))
    return TeachSession(client, names, None, 20.0, print)


def test_a_robot_named_twice_is_taught_once(tmp_path: Path) -> None:
    """A motion with every column twice would be refused when it is played."""
    taught = session(tmp_path, "f1", "f0", "f1")
    assert [each.robot for each in taught.robots] == ["f1", "f0"]
    assert taught.relaxed == ("f1", "f0")


def test_the_line_has_the_unit_of_every_axis(tmp_path: Path) -> None:
    describe = described(tmp_path)
    robot = describe["robots"]["f0"]
    robot["axes"]["wrist"] = {"min_deg": -90.0, "max_deg": 90.0}
    robot |= {"velocity_deg_s": 60.0, "acceleration_deg_s2": 600.0, "jerk_deg_s3": 6000.0}
    client = cast(Client, SimpleNamespace(describe=lambda: describe))
    state = {"state": "OFF", "fault": 0, "measured": [50.0, 60.5, -45.0]}
    line = TeachSession(client, ["f0"], None, 20.0, print)._line({"robots": {"f0": state}})
    assert line.split() == ["f0", "OFF", "50.00", "60.50", "mm", "-45.00", "deg"]


def test_no_names_are_all_robots_and_an_unknown_one_is_refused(tmp_path: Path) -> None:
    assert [each.robot for each in session(tmp_path).robots] == ["f0", "f1"]
    with pytest.raises(ContidError, match="no robot 'f9'"):
        session(tmp_path, "f0", "f9")


def test_a_recording_is_kept_although_the_pose_file_was_broken_meanwhile(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    teacher = session(tmp_path, "f0")._teacher
    teacher.press("r")
    for k in range(100):
        teacher.take({"t_s": 0.02 * k, "robots": {"f0": {"measured": [50.0 + 0.2 * k, 60.0]}}})
    (tmp_path / "hand.poses.yaml").write_text("poses: [")
    teacher.press("s")
    teacher.press("enter")
    teacher.press("r")
    assert (tmp_path / "motion1.csv").is_file()
    assert "hand.poses.yaml:1:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("grip", "answer", "message"),
    [
        (
            None,
            {"silent": {"f0": ["left"]}},
            "f0.left did not answer and may have torque",
        ),
        (0.1, {"refused": {"f1": "f1: none of its axes limits its effort"}}, "refused: f1: none of its axes"),
    ],
)
def test_a_robot_that_may_have_power_is_not_given_to_a_hand(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    grip: float | None,
    answer: dict[str, Any],
    message: str,
) -> None:
    client = SimpleNamespace(
        describe=lambda: described(tmp_path), acquire=lambda timeout_s, takeover: {},
        estop=lambda robots: answer, grip=lambda share, robots: answer,
    )  # fmt: skip
    taught = TeachSession(cast(Client, client), (), None, 20.0, print)
    with pytest.raises(ContidError, match=message) as raised:
        taught.prepare(False, grip, False)
    assert raised.value.exit_code == 4
    assert "by hand" not in capsys.readouterr().out
