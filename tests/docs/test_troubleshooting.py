"""Messages quoted in docs/troubleshooting.md are those of the code, and every fault has a row."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
SYMPTOMS = re.findall(r"^\| (?!symptom|---)(.*?) \| .* \|$", PAGE, re.MULTILINE)


def literals() -> str:
    """Every string of the code and of its build, parts of f-strings included."""
    found = [(ROOT / "CMakeLists.txt").read_text(encoding="utf-8")]
    for folder in ("contid", "drivers/contid_drivers", "extras"):
        for path in (ROOT / folder).rglob("*.py"):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            found += [
                node.value
                for node in ast.walk(tree)
                if isinstance(node, ast.Constant) and isinstance(node.value, str)
            ]
    return "\n".join(found)


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
