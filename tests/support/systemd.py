"""What systemd itself finds in a unit."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest


def need_systemd_analyze() -> None:
    """Skip a test where the program is absent."""
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed")


def verify_unit(unit: Path, instance: str, folder: Path) -> None:
    """Fail if systemd finds a fault in an instance of a unit."""
    need_systemd_analyze()
    copy = folder / unit.name.replace("@", f"@{instance}")
    # The command itself is not installed where tests run.
    copy.write_text(unit.read_text().replace("/usr/local/bin/contid", "/bin/true"))
    checked = subprocess.run(["systemd-analyze", "verify", str(copy)], capture_output=True, text=True)
    if "Failed to initialize manager" in checked.stderr:
        pytest.skip(f"systemd-analyze cannot work here: {checked.stderr.strip()}")
    assert checked.returncode == 0, checked.stderr
    assert copy.stem not in checked.stderr
