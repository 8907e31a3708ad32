"""What of a finger's limits and rest pose is refused before motion."""

from __future__ import annotations

import pytest

from contid.errors import BadInputError
from contid.robot_file.load import load_named, parse_robot_file

TEXT = load_named("finger").text
LENGTHS = "      length_mm: [0, 100]\n"


def parsed(before: str, after: str) -> None:
    assert before in TEXT
    parse_robot_file(TEXT.replace(before, after, 1), "finger.yaml")


def test_a_rest_pose_bent_beyond_the_links_is_refused() -> None:
    """Simulated fingers begin at rest: such a run in virtual time never ended."""
    with pytest.raises(BadInputError, match=r"rest_mm: its curvature is 0\.121 /mm; allowed: at most 0\.076"):
        parsed("rest_mm: [60, 60]", "rest_mm: [0, 100]")
    parsed("rest_mm: [60, 60]", "rest_mm: [35, 85]")
    with pytest.raises(BadInputError, match="its arc is 0 mm long; allowed: at least arc_length_min_mm, 1"):
        parsed("rest_mm: [60, 60]", "rest_mm: [0, 0]")
    with pytest.raises(BadInputError, match="2, for left, right"):
        parsed("rest_mm: [60, 60]", "rest_mm: [60]")


def test_a_least_arc_longer_than_the_racks_is_refused() -> None:
    """No target could be reached."""
    with pytest.raises(BadInputError, match="leaves no arc"):
        parsed(LENGTHS, f"{LENGTHS}      arc_length_min_mm: 500\n")
    parsed(LENGTHS, f"{LENGTHS}      arc_length_min_mm: 59\n")
