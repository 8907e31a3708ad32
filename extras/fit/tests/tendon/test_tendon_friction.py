"""A tendon robot with friction, as a user runs it: recorded, replayed bit for bit, and by a file without."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.command import environment

pytestmark = pytest.mark.process


def contid(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "contid", *arguments], cwd=folder, env=environment(), stdin=subprocess.DEVNULL,
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip


@pytest.mark.parametrize("more", [False, True], ids=["nine axes", "with an extra axis"])
def test_a_run_with_friction_is_replayed_bit_for_bit(tmp_path: Path, configs: Path, more: bool) -> None:
    text = (configs / "tendon3.yaml").read_text()
    if more:
        text = re.sub(
            r"(      s3.t3: .*)\n", r"\1\n      grip: {bus: servos, id: 10, mm_per_rev: 60}\n", text
        )
        text = text.replace("    rates:\n", "    extra_mm: {grip: [0, 20]}\n    rates:\n", 1)
    (tmp_path / "off.yaml").write_text(text)
    friction = "    friction: {play_mm: [0.3], capstan: [0.1]}\n    rates:\n"
    (tmp_path / "on.yaml").write_text(text.replace("    rates:\n", friction, 1))
    path = contid(
        tmp_path, "path", "circle", "--size", "60", "--height", "280", "--period", "2", "--for", "on.yaml"
    )
    assert path.returncode == 0, path.stderr
    (tmp_path / "circle.csv").write_text(path.stdout)
    run = ("run", "on.yaml", "--mock", "--virtual", "--trajectory", "circle.csv", "--record", "on.mcap")
    ran = contid(tmp_path, *run)
    assert ran.returncode == 0, ran.stderr
    replayed = contid(tmp_path, "replay", "on.mcap")
    assert replayed.returncode == 0, replayed.stderr
    # The same commands lead to other angles of the servos: without the lead the first one differs.
    other = contid(tmp_path, "replay", "on.mcap", "--robot", "off.yaml")
    assert other.returncode == 1
    assert "command" in other.stdout + other.stderr
