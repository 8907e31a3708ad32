"""The folder of the files that a run shares between processes, and the removal of those of killed runs."""

from __future__ import annotations

import fcntl
import os
import re
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

#: Records and events (`contid.control.process.ring`).
RING_FILES: Final = "contid-*.ring"
#: Files of arrays sent to the control process (`contid.control.process.pipe.BulkMessage`).
BULK_FILES: Final = "contid-*.bulk"
#: Trajectories for the recorder (`contid.session.recording_observer`).
ATTACHED_FILES: Final = "contid-*.npz"
#: How their names begin: with the process that made them. Other files called ``contid-...`` are the user's.
_OF_A_PROCESS: Final = re.compile(r"contid-\d+-")
#: A younger file may belong to a run that has not opened it yet.
STALE_S: Final = 60.0


def folder() -> Path:
    """Shared memory, or the temporary folder on a machine without it."""
    shared = Path("/dev/shm")
    return shared if shared.is_dir() else Path(tempfile.gettempdir())


def sweep() -> None:
    """Remove the files of killed runs: older than `STALE_S`, and no process has locked them.

    A run locks its ring as long as it lives. The others are not locked: the receiver removes them at once.
    """
    patterns = (RING_FILES, BULK_FILES, ATTACHED_FILES)
    for path in (path for pattern in patterns for path in folder().glob(pattern)):
        if _OF_A_PROCESS.match(path.name) is None:
            continue
        with suppress(OSError), path.open("rb") as file:
            if time.time() - os.fstat(file.fileno()).st_mtime > STALE_S:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                path.unlink()
