"""What libyaml reads quickly is what PyYAML's own parser reads: another implementation, places included."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
import yaml

from contid.errors import BadInputError
from contid.robot_file.positions import Document, read_document
from tests.robot_file.broken_files import broken, robot_files

pytestmark = pytest.mark.skipif(not yaml.__with_libyaml__, reason="PyYAML was built without libyaml")

#: Where the two differ: tabs, the place of a value that is missing, words of mistakes, characters.
APART = (
    *("a:\t1\n", "{a: }\n", "---\n \n", "a:\nb: 2\n", "- \n- 1\n", "a: [1, 2\n", "a: 'x\nb: 1\n", "\ta: 1\n"),
    *("a: é\n", "é: 1\n", "a: \x07\n", "a: 1\n---\nb: 2\n", "a: !t 1\n", "%YAML 2.0\n---\na: 1\n", "{a:1}\n"),
    *(
        "",
        "# nothing\n",
        "a: &b 1\nc: *b\n",
        "a: *b\n",
        "a: 1\na: 2\n",
        "'a': \"1\"\n",
        "a: |\n  x\n  y\n",
        "? a\n",
    ),
)


def read(text: str) -> list[str] | Document:
    try:
        return read_document(text, "file.yaml")
    except BadInputError as error:
        return [str(found) for found in error.findings]


def same(text: str, monkeypatch: pytest.MonkeyPatch) -> bool:
    quick = read(text)
    with monkeypatch.context() as patch:
        patch.setattr(yaml, "__with_libyaml__", False)
        return repr(quick) == repr(read(text))


@pytest.mark.parametrize("text", APART)
def test_where_parsers_differ_nothing_changes(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert same(text, monkeypatch)


@pytest.mark.parametrize("file", robot_files(), ids=lambda file: file.stem)
def test_a_robot_file_and_what_is_left_when_it_is_broken(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dice, text = random.Random(file.stem), file.read_text()
    for each in (text, *(broken(text, dice) for _ in range(5))):
        assert same(each, monkeypatch)


def test_a_robot_file_is_read_by_libyaml(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without its own parser everything that ships is read all the same."""
    monkeypatch.delattr(yaml, "BaseLoader")
    for file in robot_files():
        assert read_document(file.read_text(), file.name).data
