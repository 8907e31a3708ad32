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


SHARED = """\
contid: 1
robots:
  left: &left
    model: finger   # of the first hand
    correction: &c
      a_per_mm: 0.0013   # measured
      b: -0.2774
    rest_mm: &r [1, 2]
    sections:
      - &s {length_mm: 40, modulus_pa: 1.0}
      - *s
      - *s
  right:
    <<: *left
    correction: *c
    rest_mm: *r
  third:
    <<: [*left]
"""


@pytest.mark.parametrize(
    "key",
    [
        "robots.left.correction.b", "robots.right.correction.b", "robots.third.correction.b",
        "robots.left.sections.0.modulus_pa", "robots.left.sections.1.modulus_pa", "robots.left.rest_mm",
        "robots.right.sections.2.modulus_pa", "robots.right.rest_mm", "robots.left.model",
        "robots.right.model", "robots.left.correction", "robots.third.new",
    ],
)  # fmt: skip
def test_a_value_that_others_share_is_written_for_its_key_alone(key: str) -> None:
    """PyYAML is the witness."""

    def flat(node: object, above: str = "") -> dict[str, object]:
        pairs = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
        found: dict[str, object] = {} if isinstance(node, dict | list) else {above: node}
        for name, inner in pairs:
            found |= flat(inner, f"{above}.{name}" if above else str(name))
        return found

    value: object = [7.5, 8.5] if key.endswith("rest_mm") else 7.5
    text = edited(SHARED, [Change(key, value, "fitted")])  # type: ignore[arg-type]
    before, after = flat(yaml.safe_load(SHARED)), flat(yaml.safe_load(text))
    changed = {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)}
    assert changed
    assert all(name == key or name.startswith(f"{key}.") for name in changed)
    assert "# of the first hand" in text or key == "robots.left.model"
    # Writing again changes the same place alone.
    twice = flat(yaml.safe_load(edited(text, [Change(key, value, "again")])))  # type: ignore[arg-type]
    assert twice == after


def test_two_changes_below_one_alias_are_both_written() -> None:
    changes = [Change(f"robots.right.correction.{key}", 5.0) for key in ("a_per_mm", "b")]
    robots = yaml.safe_load(edited(SHARED, changes))["robots"]
    assert robots["right"]["correction"] == {"a_per_mm": 5.0, "b": 5.0}
    assert robots["left"]["correction"] == robots["third"]["correction"] == {"a_per_mm": 0.0013, "b": -0.2774}


def test_what_cannot_be_written_alone_is_refused() -> None:
    """The library writes a mapping of one pair in a list without braces: its anchor is that of the key."""
    with pytest.raises(ContidError, match=r"list\.1\.m: cannot be written alone"):
        edited("list: [&s {m: 1}, *s, *s]\n", [Change("list.1.m", 7)])


@pytest.mark.parametrize("text", ["robots: [1, 2\nb: 3\n", "robots: {}\nrobots: {}\n"])
def test_a_file_that_is_no_longer_yaml_is_refused_with_the_place(text: str, tmp_path: Path) -> None:
    """A person may edit it while `contid home` moves the robot."""
    path = tmp_path / "robot.yaml"
    path.write_text(text)
    with pytest.raises(ContidError, match=r"robots\.a: not written, the file is not YAML: .*line 2, column"):
        set_values(path, [Change("robots.a", 7)])
    assert path.read_text() == text


def test_ends_of_lines_stay(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_bytes(b"name: a  # mine\r\nother:\r\n  - 1\r\n")
    set_values(path, [Change("name", "b")])
    assert path.read_bytes() == b"name: b  # mine\r\nother:\r\n  - 1\r\n"
