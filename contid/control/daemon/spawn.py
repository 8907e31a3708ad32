"""Starting the control process before anything heavy is imported here: both then import side by side."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from typing import Final

#: Threads of a linear-algebra library have no place beside a tick, and looking for plug-ins of pydantic costs
#: a twentieth of a second of every start.
ENVIRONMENT: Final = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "PYDANTIC_DISABLE_PLUGINS": "__all__",
}


@dataclass(slots=True)
class Spawned:
    """A control process that waits for its setup, and the writing end of its pipe."""

    process: subprocess.Popen[bytes]
    pipe: int


def spawn() -> Spawned:
    """Start ``python -m contid.control.process``; the imports that follow here skip the plug-ins too."""
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", ENVIRONMENT["PYDANTIC_DISABLE_PLUGINS"])
    inside, pipe = os.pipe()
    command = [sys.executable, "-m", "contid.control.process", str(inside), str(os.getpid())]
    try:
        # A session of its own: Ctrl-C and a closed terminal reach the daemon only.
        process = subprocess.Popen(
            command,
            pass_fds=[inside],
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            env={**os.environ, **ENVIRONMENT},
        )
    except BaseException:
        os.close(pipe)
        raise
    finally:
        os.close(inside)
    return Spawned(process, pipe)
