"""Broken on purpose: whatever becomes of a robot file, the answer is a list of places, never a crash."""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest

from contid.errors import BadInputError, Located
from contid.robot_file.load import parse_robot_file
from tests.support.robot_configs import FAMILIES

#: A campaign sets this to tens of thousands; the short form keeps CI quick.
ROUNDS = int(os.environ.get("CONTID_BROKEN_FILES", "25"))
VALUES = (
    *("", "-1", "0", "1e9", "1e-300", "[]", "{}", "[1, 2]", "{a: 1}", "abc", ".nan", "true", "null"),
    *("[[1, 2], [3]]", "'x'", "*none", "!t 1"),
)


def broken(text: str, dice: random.Random) -> str:
    """One to four lines deleted, doubled, cut, with another value or another unit."""
    lines = text.split("\n")
    for _ in range(dice.randint(1, 4)):
        at = dice.randrange(len(lines))
        line = lines[at]
        match dice.randrange(5):
            case 0:
                lines[at : at + 1] = []
            case 1:
                lines.insert(at, line)
            case 2:
                lines[at] = line[: dice.randint(0, len(line))]
            case 3:
                lines[at] = line.replace("_m", "_x", 1)
            case _ if ":" in line:
                key, _, rest = line.partition(":")
                lines[at] = f"{key}: {dice.choice(VALUES)}{rest[rest.find(',') :] if ',' in rest else ''}"
        lines = lines or [""]
    return "\n".join(lines)


def findings(text: str, name: str) -> list[Located]:
    """What is wrong with a text, nothing when it is a robot file."""
    try:
        parse_robot_file(text, name)
    except BadInputError as error:
        return list(error.findings)
    return []


def robot_files() -> list[Path]:
    return sorted((Path(__file__).parent.parent.parent / "configs").glob("*.yaml"))


@pytest.mark.parametrize(
    "file",
    [
        # Emulated ones differ in their ports.
        pytest.param(file, marks=() if file.stem in FAMILIES else pytest.mark.campaign, id=file.stem)
        for file in robot_files()
    ],
)
def test_a_broken_file_is_answered_with_places(file: Path) -> None:
    dice = random.Random(file.stem)
    text = file.read_text()
    refused = 0
    for _ in range(ROUNDS):
        bad = broken(text, dice)
        found = findings(bad, file.name)
        refused += bool(found)
        lines = bad.count("\n") + 2
        assert all(1 <= each.line <= lines and each.column >= 1 for each in found)
        assert len(set(found)) == len(found)
    # Some mutilations only touch comments or are harmless; most are not.
    assert refused > ROUNDS // 3
