"""Robot files read with the compiled parser of YAML are those that PyYAML alone reads."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from contid.errors import BadInputError
from contid.robot_file import positions

#: What YAML gives a meaning, and what a hand slips in.
PIECES = (
    "a", "b: ", "- ", "? ", ": ", ":", "[", "]", "{", "}", ",", ", ,", "{}", "[a: b]", "{a:1}", "{a: }",
    "['a':1]", "\n", "\n  ", "\n    ", " ", "\t", "'", '"', "#", " #", "&x ", "*x", "!t ", "|", "|-\n  ",
    ">\n  ", "%", "@", "`", "---\n", "...\n", "%YAML 1.1\n", "<<: ", "~", "1e-3", "\\n", "\\x41", "::",
    "\x07", "\x7f", "\u200b", "\xb0",
)  # fmt: skip


def read(text: str) -> object:
    """What `read_document` makes of a text, or its findings."""
    try:
        found = positions.read_document(text, "f")
    except BadInputError as error:
        return str(error)
    return repr(found.data), list(found.keys.items()), list(found.values.items())


def disturbed(text: str, draw: random.Random) -> str:
    """Some lines of a robot file, with up to three pieces in place of characters."""
    lines = text.split("\n")
    begin = draw.randrange(len(lines))
    text = "\n".join(lines[begin : begin + draw.randrange(3, 15)])
    for _ in range(draw.randrange(4)):
        at = draw.randrange(len(text) + 1)
        text = text[:at] + draw.choice(PIECES) + text[at + draw.randrange(3) :]
    return text


@pytest.mark.parametrize("count", [600, pytest.param(30_000, marks=pytest.mark.campaign)])
def test_both_parsers_read_the_same(count: int, configs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shipped = [path.read_text() for path in sorted(configs.glob("*.yaml"))]
    draw, texts = random.Random(count), [*shipped]
    for number in range(count):
        soup = "".join(draw.choices(PIECES, k=draw.randrange(1, 14)))
        texts.append(soup if number % 2 else disturbed(draw.choice(shipped), draw))
    compiled = [read(text) for text in texts]
    monkeypatch.setattr(positions, "_COMPILED", None)
    accepted = 0
    for text, found in zip(texts, compiled, strict=True):
        assert read(text) == found, repr(text)
        accepted += isinstance(found, tuple)
    assert accepted > 0.1 * len(texts)
