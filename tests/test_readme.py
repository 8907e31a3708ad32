"""The templates of tests/README.md are tests that pass."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

import pytest

PAGE = Path(__file__).with_name("README.md")
TEMPLATES = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)


@pytest.mark.process
@pytest.mark.parametrize("number", range(3))
def test_a_template_passes(number: int, request: pytest.FixtureRequest) -> None:
    names: dict[str, Any] = {"pytest": pytest}
    exec(TEMPLATES[number], names)
    (test,) = [value for name, value in names.items() if name.startswith("test_")]
    test(**{name: request.getfixturevalue(name) for name in inspect.signature(test).parameters})


def test_the_page_is_one_page() -> None:
    assert len(TEMPLATES) == 3
    assert len(PAGE.read_text().splitlines()) <= 80
