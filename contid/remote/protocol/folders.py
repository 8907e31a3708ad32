"""The folder of the sockets of one user."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path


def default_directory() -> Path:
    """The folder of this user's sockets; it may not exist yet."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime:
        return Path(runtime) / "contid"
    return Path(tempfile.gettempdir()) / f"contid-{os.geteuid()}"
