"""The pages made from the tables of the code are those of the documentation."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from contid.control.tick.faults import PAGES
from contid.control.tick.supervisor import MOVES, Mode
from contid_manual.fault import MEANING, command, pages, states_page

DOCS = Path(__file__).parents[3] / "docs"


@pytest.mark.parametrize("name", list(pages()))
def test_a_page_is_current(name: str) -> None:
    hint = "run `python -m contid fault --write docs`"
    assert (DOCS / name).read_text(encoding="utf-8") == pages()[name], hint


def test_there_is_a_page_for_every_fault_and_no_other() -> None:
    assert {path.stem for path in (DOCS / "faults").glob("*.md")} == {str(int(fault)) for fault in PAGES}


def test_the_diagram_has_every_state_and_every_move() -> None:
    text = states_page()
    assert set(MEANING) == set(Mode)
    for (start, event), end in MOVES.items():
        row = next(line for line in text.splitlines() if line.startswith(f"| {start.name} |"))
        assert f"{event.value} -> {end.name}" in row


def test_writing_the_pages_of_one_fault_is_refused(tmp_path: Path) -> None:
    done = CliRunner().invoke(command, ["101", "--write", str(tmp_path)])
    assert done.exit_code == 2
    assert "leave NUMBER out" in done.output
    assert list(tmp_path.iterdir()) == []
