"""Vendored modules are the files that their table names."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import pytest

STATIC = Path(__file__).parents[1] / "contid_panel" / "static"
ROWS = re.findall(r"^\| `([^`]+)` .*`([0-9a-f]{64})` \|$", (STATIC / "vendor/README.md").read_text(), re.M)


def test_every_vendored_file_is_in_the_table() -> None:
    found = {
        p.relative_to(STATIC / "vendor").as_posix() for p in (STATIC / "vendor").rglob("*") if p.is_file()
    }
    assert {name for name in found if Path(name).suffix in (".js", ".css")} == {name for name, _ in ROWS}
    assert "uplot/LICENSE" in found


@pytest.mark.parametrize(("name", "sha256"), ROWS)
def test_a_vendored_file_is_unchanged(name: str, sha256: str) -> None:
    assert hashlib.sha256((STATIC / "vendor" / name).read_bytes()).hexdigest() == sha256


def test_the_page_needs_no_other_machine_and_no_inline_code() -> None:
    """What the policy refuses would be seen late, in a browser."""
    html = (STATIC / "index.html").read_text()
    assert not re.findall(r"""(?:src|href)=["'](?!/static/)""", html)
    assert not re.findall(r"<script(?![^>]*src=)|<style|\sstyle=|\son\w+=", html)
    for path in STATIC.glob("*.js"):
        assert not re.findall(r"innerHTML|outerHTML|insertAdjacentHTML|eval\(|https?://", path.read_text()), (
            path
        )
