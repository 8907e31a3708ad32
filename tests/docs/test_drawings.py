"""The drawings of the docs are those their scripts draw, with the numbers of the robot files."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from docs.drawings import model_drawings, processes, robot_drawings, wiring
from docs.drawings.svg import IMAGES

ROOT = Path(__file__).parent.parent.parent
DRAWINGS = {**robot_drawings.DRAWINGS, **model_drawings.DRAWINGS, **processes.DRAWINGS, **wiring.DRAWINGS}


def numbers(svg: str) -> list[float]:
    """Its pixels; their last digit may depend on the processor."""
    return [float(text) for text in re.findall(r"-?\d+\.\d", svg)]


@pytest.mark.parametrize("name", DRAWINGS)
def test_the_committed_drawing_is_the_scripts(name: str) -> None:
    committed, drawn = (IMAGES / name).read_text(encoding="utf-8"), DRAWINGS[name]().svg()
    assert re.sub(r"-?\d+\.\d", "#", committed) == re.sub(r"-?\d+\.\d", "#", drawn)
    assert numbers(drawn) == pytest.approx(numbers(committed), abs=0.2)
    assert ElementTree.fromstring(drawn).tag.endswith("svg")


def test_dimensions_and_azimuths_are_those_of_the_robot_files() -> None:
    hand = (ROOT / "configs" / "hand.yaml").read_text(encoding="utf-8")
    spacing = yaml.safe_load(hand)["robots"]["left"]["geometry"]["rack_spacing_mm"]
    assert f"rack_spacing_mm {spacing}" in DRAWINGS["axes-hand.svg"]().svg()
    # Layout `paper` of docs/robots/cbha.md; `TriRack`: (-phi, -phi + 120, -phi - 120); chamber pair 1 on +x.
    for name, azimuths in {
        "axes-cbha.svg": ("l1: 180", "l2: 60", "l3: 300"),
        "axes-trirack2.svg": ("l1: 180", "l2: 300", "l3: 60"),
        "axes-stiffflop2.svg": ("p1: 0", "p2: 120", "p3: 240"),
    }.items():
        drawn = DRAWINGS[name]().svg()
        assert [each for each in azimuths if f"{each} deg" not in drawn] == []
