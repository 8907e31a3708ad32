"""Pose files: mistakes with their places, saving without loss of what a person wrote."""

from __future__ import annotations

import re
import threading
from pathlib import Path

import pytest
import yaml

from contid.errors import BadInputError, ContidError
from contid.robot_file.load import find_robot_file
from contid_hands.teach.pose_file import parse_pose_file, read_pose_file
from contid_hands.teach.pose_store import default_pose_file, save_pose

GOOD = """\
contid_poses: 1
poses:
  # flat on the table
  open: {target: {x_mm: 40, y_mm: 75}}
  close: {target: {left_mm: 60, right_mm: 58}, saved: by hand}
sequence:
  - {pose: open, time_s: 2, wait_s: 0.5}
  - {loop: 3, steps: [{pose: close}, {wait_s: 1}]}
"""


def test_a_good_file_is_read() -> None:
    file = parse_pose_file(GOOD, Path("p.yaml"))
    assert file.pose("open").target == {"x_mm": 40.0, "y_mm": 75.0}
    first, second = file.contents.sequence
    assert (first.pose, first.time_s, first.wait_s) == ("open", 2.0, 0.5)
    assert second.loop == 3
    assert second.steps is not None
    assert [step.pose for step in second.steps] == ["close", None]


@pytest.mark.parametrize(
    ("wrong", "right", "finding"),
    [
        (
            "pose: open",
            "pose: opne",
            "p.yaml:7:12: no pose 'opne'; allowed: open, close; did you mean 'open'?",
        ),
        (
            "pose: close",
            "pose: ",
            "p.yaml:8:23: steps: item 1: a step needs pose, trajectory, loop or wait_s",
        ),
        ("wait_s: 0.5", "wait_ms: 5", "p.yaml:7:29: unknown key 'wait_ms'; allowed: pose, time_s"),
        ("loop: 3, ", "", "p.yaml:8:5: sequence: item 2: loop and steps belong together"),
        ("{wait_s: 1}", "{time_s: 1, wait_s: 1}", "p.yaml:8:47: steps: item 2: time_s belongs to a pose"),
        (
            "{wait_s: 1}",
            "{pose: open, loop: 1, steps: []}",
            "p.yaml:8:67: steps: allowed is at least 1 items",
        ),
        ("{wait_s: 1}", "{trajectory: none.csv}", "p.yaml:8:51: no file none.csv"),
        (
            "{wait_s: 1}",
            f"{{trajectory: {'x' * 300}}}",
            f"p.yaml:8:51: {'x' * 300}: File name too long",
        ),
        ("x_mm: 40", "x_mm: forty", "p.yaml:4:25: x_mm: input should be a valid number"),
        ("x_mm: 40", "x_mm: .nan", "p.yaml:4:25: x_mm: allowed is a finite number"),
        ("contid_poses: 1", "contid: 1", "p.yaml:1:1: unknown key 'contid'"),
        ("time_s: 2", "time_s: 0", "p.yaml:7:26: time_s: allowed is a number at least 0.01, not 0"),
        ("  close:", "  open:", "p.yaml:5:3: "),
    ],
)
def test_a_mistake_has_its_place(wrong: str, right: str, finding: str) -> None:
    assert wrong in GOOD
    with pytest.raises(BadInputError, match=re.escape(finding)):
        parse_pose_file(GOOD.replace(wrong, right, 1), Path("p.yaml"))


def test_saving_keeps_comments_and_other_poses_and_replaces_in_one_step(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(GOOD)
    seen: set[int] = set()
    done = threading.Event()

    def watch() -> None:
        while not done.is_set():
            seen.add(len(read_pose_file(path).contents.poses))

    reader = threading.Thread(target=watch)
    reader.start()
    try:
        assert not save_pose(path, "mid", {"x_mm": 1.0 / 3.0, "y_mm": 80.0}, "2026, by a test", "finger.yaml")
        assert save_pose(path, "open", {"x_mm": 41.0, "y_mm": 75.0}, "2026, by a test", "finger.yaml")
    finally:
        done.set()
        reader.join()
    assert seen <= {2, 3}  # never half a file
    text = path.read_text()
    assert "# flat on the table" in text
    # Read by another parser.
    data = yaml.safe_load(text)
    assert data["poses"]["mid"] == {"target": {"x_mm": 0.333333, "y_mm": 80.0}, "saved": "2026, by a test"}
    assert data["poses"]["open"]["target"]["x_mm"] == 41.0
    assert data["sequence"] == yaml.safe_load(GOOD)["sequence"]
    assert [each.name for each in tmp_path.iterdir()] == ["p.yaml"]


def test_a_new_file_is_made_and_a_wrong_one_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "new.yaml"
    save_pose(path, "a", {"x_mm": 1.0}, "now", "finger.yaml")
    assert read_pose_file(path).contents.robot_file == "finger.yaml"
    assert path.stat().st_mode & 0o777 == 0o644
    path.write_text("contid: 1\n")
    with pytest.raises(BadInputError, match="unknown key 'contid'"):
        save_pose(path, "a", {"x_mm": 1.0}, "now", "finger.yaml")
    assert path.read_text() == "contid: 1\n"
    with pytest.raises(ContidError, match=r"'open\\n' is no name of a pose"):
        save_pose(tmp_path / "other.yaml", "open\n", {"x_mm": 1.0}, "now", "finger.yaml")
    with pytest.raises(ContidError, match="'two words' is no name of a pose"):
        save_pose(tmp_path / "other.yaml", "two words", {"x_mm": 1.0}, "now", "finger.yaml")
    with pytest.raises(ContidError, match=r"cannot write it: No such file"):
        save_pose(tmp_path / "missing" / "p.yaml", "a", {"x_mm": 1.0}, "now", "finger.yaml")


def test_poses_of_a_shipped_robot_are_kept_in_the_present_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = default_pose_file(find_robot_file("hand"))
    assert path.resolve() == tmp_path / "hand.poses.yaml"
    save_pose(path, "a", {"left.x_mm": 1.0}, "now", "hand.yaml")
    assert (tmp_path / "hand.poses.yaml").exists()


def test_the_file_of_a_robot_file(tmp_path: Path) -> None:
    robot = tmp_path / "hand.yaml"
    assert default_pose_file(robot).name == "hand.poses.yaml"
    (tmp_path / "poses.yaml").touch()
    assert default_pose_file(robot).name == "poses.yaml"
    (tmp_path / "hand.poses.yaml").touch()
    assert default_pose_file(robot).name == "hand.poses.yaml"
