"""Decision records are numbered without gaps, dated, and listed in their index with the same status."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent.parent.parent / "docs" / "decisions"
RECORDS = sorted(path for path in FOLDER.glob("*.md") if path.name != "README.md")


def test_numbers_have_no_gaps() -> None:
    assert [int(path.name[:4]) for path in RECORDS] == list(range(1, len(RECORDS) + 1))


@pytest.mark.parametrize("record", RECORDS, ids=lambda path: path.name)
def test_the_index_agrees_with_the_record(record: Path) -> None:
    text = record.read_text(encoding="utf-8")
    head = re.match(rf"# {record.name[:4]}: (.+)\nDate: (\d{{4}}-\d\d-\d\d) · Status: (.+)\n", text)
    assert head, "the first two lines are: # NUMBER: title, Date: YYYY-MM-DD · Status: ..."
    title, date, status = head.groups()
    line = f"| [{record.name[:4]}]({record.name}) {title} | {date} | {status} |"
    assert line in (FOLDER / "README.md").read_text(encoding="utf-8").splitlines()
    assert all(f"**{part}.**" in text for part in ("Context", "Decision", "Consequences"))
