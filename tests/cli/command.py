"""Running the real command the way a user does, in a process of its own."""

from __future__ import annotations

import subprocess
import sys


def contid(*arguments: str, stdin: str = "", timeout_s: float = 60.0) -> subprocess.CompletedProcess[str]:
    """Run ``contid ARGUMENTS`` with text on stdin; stdout, stderr and the exit code come back."""
    return subprocess.run(
        [sys.executable, "-m", "contid", *arguments],
        input=stdin,
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )
