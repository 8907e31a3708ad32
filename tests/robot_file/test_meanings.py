"""The meanings of keys do not depend on how an interpreter indents docstrings: from Python 3.13 on less."""

from __future__ import annotations

from inspect import cleandoc

from pydantic import BaseModel

from contid_manual.robot_file_page import robot_file_page
from contid_manual.schema import meanings


class Indented(BaseModel):
    """A part.

    Attributes:
        length_mm: from the base: the centreline,
            only: no tool.
        low, high: limits.
    """


class Dedented(BaseModel):
    __doc__ = cleandoc(Indented.__doc__ or "")


def test_the_indentation_of_a_docstring_does_not_matter():
    assert meanings(Indented) == {
        "length_mm": "from the base: the centreline, only: no tool.",
        "low": "limits.",
        "high": "limits.",
    }
    assert meanings(Dedented) == meanings(Indented)


def test_every_backtick_of_the_page_is_closed_on_its_line() -> None:
    assert [line for line in robot_file_page().splitlines() if line.count("`") % 2] == ["```yaml", "```"]
