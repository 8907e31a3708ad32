"""Every ``python`` block of docs/library.md runs as it is printed, in order, from an empty directory."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from contid.remote.protocol.socket_path import is_listening
from tests.support.command import environment, program
from tests.support.waiting import until

pytestmark = pytest.mark.process

ROOT = Path(__file__).parent.parent.parent


def variables(folder: Path) -> dict[str, str]:
    return {**environment(), "MPLBACKEND": "Agg", "XDG_RUNTIME_DIR": str(folder)}


def test_the_page_begins_with_what_to_do() -> None:
    heading, first = (ROOT / "docs" / "library.md").read_text().splitlines()[:2]
    assert heading.startswith("# ")
    assert first.startswith("Load ")


@pytest.mark.realtime
def test_the_five_lines_move_the_hand(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "first-motion.md").read_text()
    (block,) = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    lines = [line for line in block.splitlines() if line.strip()]
    assert len(lines) == 5
    daemon = [sys.executable, "-m", "contid", "run", "hand", "--mock"]
    running = subprocess.Popen(
        daemon, cwd=tmp_path, env=variables(tmp_path), stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        socket = tmp_path / "contid" / "hand.sock"
        until(lambda: is_listening(socket), "the daemon listens")
        done = subprocess.run(
            program(block),
            cwd=tmp_path,
            env=variables(tmp_path),
            capture_output=True,
            text=True,
            timeout=100,
            check=False,
        )
    finally:
        running.terminate()
        running.wait(30)
    assert done.returncode == 0, done.stderr
    x_mm, y_mm = (float(number) for number in re.findall(r"[\d.]+", done.stdout)[:2])
    assert (x_mm, y_mm) == pytest.approx((10.0, 80.0), abs=1.0)


@pytest.mark.slow
def test_the_examples_run_in_order(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "library.md").read_text()
    blocks = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    code = "import warnings\nwarnings.simplefilter('error')\n" + "\n".join(blocks)
    done = subprocess.run(
        program(code),
        cwd=tmp_path,
        env=variables(tmp_path),
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    # What the comments of the page print.
    for printed in ("(3, 6)", "[ True  True False]", "('left', 'right')", "(2, 21, 3)"):
        assert printed in done.stdout
    assert "tips has shape (1, 2); expected: (3,) or (N, 3) with columns x_mm, y_mm, z_mm" in done.stdout
