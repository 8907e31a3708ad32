"""Values written back into a robot file: comments stay, and the file is the old or the new one."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from contid.errors import ContidError
from contid.robot_file.edit import Change, edited, set_values
from contid.robot_file.load import load_robot_file

TEXT = """\
# A hand.
contid: 1
robots:
  left:   # the left finger
    axes:
      # A pinion of 15 teeth.
      left: {bus: servos, id: 1, mm_per_rev: 37.699}
      right:
        bus: servos   # the only one
        zero_deg: 1.5 # measured with a ruler

        # Counted on the pinion.
        mm_per_rev: 37.699
"""


def test_comments_order_and_style_survive() -> None:
    key = "robots.left.axes.right.zero_deg"
    text = edited(TEXT, [Change(key, -12.25, "homed")])
    assert text == TEXT.replace("zero_deg: 1.5 # measured with a ruler", "zero_deg: -12.25 # homed")


def test_a_missing_last_key_is_added_also_in_flow_style() -> None:
    text = edited(TEXT, [Change("robots.left.axes.left.zero_deg", 7.5, "homed")])
    assert "left: {bus: servos, id: 1, mm_per_rev: 37.699, zero_deg: 7.5}" in text
    assert "# homed" in text
    assert "# A pinion of 15 teeth." in text
    assert edited(text, [Change("robots.left.axes.left.zero_deg", 7.5, "homed")]) == text


SECTIONS = {
    "block": """\
robots:
  arm:
    geometry:
      sections:
        - length_mm: 50  # a rule
          modulus: 1.0
        - length_mm: 40
      after: 3
""",
    "flow in a block list": """\
robots:
  arm:
    geometry:
      sections:
        - {length_mm: 50, modulus: 1.0}  # a rule
        - {length_mm: 40}

      # Counted.
      after: 3
""",
    "flow list": """\
robots:
  arm:
    geometry:
      sections: [{length_mm: 50, modulus: 1.0}, {length_mm: 40}]  # a rule
      after: 3
""",
    "flow on several lines": """\
robots:
  arm:
    geometry: {
      sections: [
        {length_mm: 50, modulus: 1.0},  # a rule
        {length_mm: 40},  # another
      ],
      after: 3}
""",
    "flow robot": "robots:\n  arm: {geometry: {sections: [{length_mm: 50, modulus: 1.0}, "
    "{length_mm: 40}], after: 3}}\n",
    "flow document": "{robots: {arm: {geometry: {sections: [{length_mm: 50, modulus: 1.0}, "
    "{length_mm: 40}], after: 3}}}}\n",
}


@pytest.mark.parametrize("style", SECTIONS)
def test_elements_of_lists_are_written_in_every_style(style: str) -> None:
    """PyYAML reads the new numbers and every old value; a second writing changes nothing."""
    at = "robots.arm.geometry.sections"
    changes = [
        Change(f"{at}.0.modulus", [1.5, -2.5], "measured"),
        Change(f"{at}.1.modulus", [3.5], "measured later"),
        Change(f"{at}.1.gain", 0.5, "measured later"),
    ]
    text = edited(SECTIONS[style], changes)
    sections = [{"length_mm": 50, "modulus": [1.5, -2.5]}, {"length_mm": 40, "modulus": [3.5], "gain": 0.5}]
    assert yaml.safe_load(text) == {"robots": {"arm": {"geometry": {"sections": sections, "after": 3}}}}
    assert ("# measured later" in text) == (style != "flow document")
    assert ("# Counted.\n      after" in text) == (style == "flow in a block list")
    assert edited(text, changes) == text


def test_a_missing_mapping_is_named() -> None:
    with pytest.raises(ContidError, match=r"the file has no key robots\.right"):
        edited(TEXT, [Change("robots.right.axes.left.zero_deg", 1.0)])


def test_all_or_none(tmp_path: Path) -> None:
    path = tmp_path / "hand.yaml"
    path.write_text(TEXT)
    good = Change("robots.left.axes.right.zero_deg", 3.0)
    with pytest.raises(ContidError):
        set_values(path, [good, Change("robots.none.axes", 1.0)])
    assert path.read_text() == TEXT


def test_an_interrupted_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "hand.yaml"
    path.write_text(TEXT)

    def interrupted(handle: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("os.fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        set_values(path, [Change("robots.left.axes.right.zero_deg", 3.0)])
    assert path.read_text() == TEXT
    assert list(tmp_path.iterdir()) == [path]


def test_the_mode_of_the_file_and_a_link_to_it_survive(tmp_path: Path) -> None:
    path, link = tmp_path / "hand.yaml", tmp_path / "link.yaml"
    path.write_text(TEXT)
    path.chmod(0o640)
    link.symlink_to(path)
    set_values(link, [Change("robots.left.axes.right.zero_deg", 3.0)])
    assert link.is_symlink()
    assert path.stat().st_mode & 0o777 == 0o640
    assert "zero_deg: 3.0 #" in path.read_text()


def test_a_shipped_robot_file_is_valid_after_an_edit(configs: Path, tmp_path: Path) -> None:
    path = tmp_path / "hand.yaml"
    path.write_text((configs / "hand.yaml").read_text())
    set_values(path, [Change("robots.left.axes.right.zero_deg", 12.5, "homed")])
    assert load_robot_file(path).file.robots["left"].axes["right"].zero_deg == 12.5
    before, after = (configs / "hand.yaml").read_text().splitlines(), path.read_text().splitlines()
    assert len([line for line in after if line not in before]) == 1


LISTED = """\
a:
  placeholder:
    - one  # first
    - two
    - three  # third

# After all.
b: 1
"""


@pytest.mark.parametrize(
    "new", [["one", "two"], ["two", "three"], ["three"], ["one"], [], ["one", "two", "three"]]
)
def test_a_shorter_list_keeps_its_comments_and_what_follows(new: list[str]) -> None:
    text = edited(LISTED, [Change("a.placeholder", new)])
    assert yaml.safe_load(text) == {"a": {"placeholder": new}, "b": 1}
    assert text.endswith("\n\n# After all.\nb: 1\n")
    assert ("# first" in text, "# third" in text) == ("one" in new, "three" in new)
