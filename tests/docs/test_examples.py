"""Every ``sh`` block of README and docs runs as it is printed."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

from tests.support.plugins.forked import environment
from tests.support.plugins.shell import contid_for_shells

ROOT = Path(__file__).parent.parent.parent


def blocks(page: str) -> list[str]:
    return re.findall(r"^```sh\n(.*?)^```", (ROOT / page).read_text(), re.MULTILINE | re.DOTALL)


PAGES = [
    name
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
    if blocks(name := str(page.relative_to(ROOT)))
]
#: Pages whose commands other tests run, with their figures: here in campaigns. In CI they are parsed.
RARE = (
    *("docs/first-hour.md", "docs/robots/dynamics.md", "docs/robots/identify.md", "docs/sessions.md"),
    "docs/trajectories.md",
)
#: Commands fork. In campaigns those of the first page start as a reader starts them as well.
STARTED = [
    *(pytest.param(page, marks=pytest.mark.campaign if page in RARE else ()) for page in PAGES),
    pytest.param("README.md", marks=pytest.mark.campaign, id="README.md as a reader"),
]


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.realtime
@pytest.mark.parametrize("page", STARTED)
def test_the_commands_of_a_page_run(page: str, tmp_path: Path) -> None:
    commands = tmp_path / "bin"
    commands.mkdir()
    work = tmp_path / "work"
    work.mkdir()
    variables = {
        **environment(),
        "PATH": f"{commands}:{os.environ['PATH']}",
        "CONFIGS": str(ROOT / "configs"),
        "XDG_RUNTIME_DIR": str(tmp_path),
    }
    found = blocks(page)
    assert found, f"{page} has no sh block"
    # One shell for the page: later blocks use the files of earlier ones. Ctrl-C reaches a background job.
    script = "set -eo pipefail\nset -m\ntrap 'kill $(jobs -p) 2>/dev/null || true' EXIT\n" + "\n".join(found)
    # stdin must be empty, not pytest's: `contid run` reads a trajectory from it.
    with contid_for_shells(commands):
        done = subprocess.run(
            ["bash", "-c", script],
            cwd=work,
            env=variables,
            capture_output=True,
            text=True,
            timeout=240,
            stdin=subprocess.DEVNULL,
            check=False,
        )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    assert "Traceback" not in done.stderr


def test_rare_pages_are_pages() -> None:
    assert set(RARE) < set(PAGES)


def test_no_two_pages_record_to_the_same_file() -> None:
    """A reader goes from one page to the next in one folder, where recordings are never overwritten."""
    recorded = [
        file for page in PAGES for block in blocks(page) for file in re.findall(r"--record (\S+)", block)
    ]
    assert len(recorded) == len(set(recorded)), recorded


def test_the_readme_is_short() -> None:
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 150


def test_ci_runs_exactly_the_test_command_of_the_readme() -> None:
    command = next(s for s in (ROOT / "README.md").read_text().splitlines() if "pytest" in s)
    assert command in (ROOT / ".ci" / "run").read_text().splitlines()
