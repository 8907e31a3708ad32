"""Messages quoted in docs/troubleshooting.md are those of the code, and every fault has a row."""

from __future__ import annotations

import re
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType

ROOT = Path(__file__).parent.parent.parent
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
SYMPTOMS = re.findall(r"^\| (?!symptom|---)(.*?) \| .* \|$", PAGE, re.MULTILINE)


def literals() -> str:
    """Every string of the code and of its build, parts of f-strings included."""
    found = [(ROOT / "CMakeLists.txt").read_text(encoding="utf-8")]
    for folder in ("contid", "drivers/contid_drivers", "extras"):
        for path in (ROOT / folder).rglob("*.py"):
            # As Python keeps it compiled: to parse all of it takes ten times as long.
            code = SourceFileLoader(path.stem, str(path)).get_code(path.stem)
            assert code is not None
            found += strings(code.co_consts)
    return "\n".join(found)


def strings(constants: tuple[object, ...]) -> list[str]:
    found = []
    for each in constants:
        if isinstance(each, str):
            found.append(each)
        elif isinstance(each, CodeType):
            found += strings(each.co_consts)
        elif isinstance(each, (tuple, frozenset)):
            found += strings(tuple(each))
    return found


def test_quoted_messages_are_in_the_code() -> None:
    quoted = [text for symptom in SYMPTOMS for text in re.findall(r"`([^`]+)`", symptom)]
    assert len(quoted) > 20
    code = literals()
    options = {"--record", "--view FILE", "contid replay"}
    assert not [text for text in quoted if text not in code and text not in options]


def test_every_fault_has_a_row() -> None:
    rows = " ".join(SYMPTOMS)
    numbers = {page.stem for page in (ROOT / "docs" / "faults").glob("[0-9]*.md")}
    assert numbers == set(re.findall(r"faults/(\d+)\.md", rows))
