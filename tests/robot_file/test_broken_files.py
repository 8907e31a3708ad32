"""Broken on purpose: whatever becomes of a robot file, the answer is a list of places, never a crash."""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest

from contid.errors import BadInputError, Located
from contid.robot_file.load import parse_robot_file
from tests.robot_file.broken_files import broken, robot_files

#: A campaign sets this to tens of thousands; the short form keeps CI quick.
ROUNDS = int(os.environ.get("CONTID_BROKEN_FILES", "40"))


def findings(text: str, name: str) -> list[Located]:
    """What is wrong with a text, nothing when it is a robot file."""
    try:
        parse_robot_file(text, name)
    except BadInputError as error:
        return list(error.findings)
    return []


@pytest.mark.parametrize("file", robot_files(), ids=lambda file: file.stem)
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
