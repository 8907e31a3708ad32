"""Starts the control process before the daemon imports anything heavy, so that both import in parallel."""

from __future__ import annotations

import os
import subprocess
from dataclasses import dataclass
from typing import Final

from contid.child_module import module_command

#: Threads of a linear-algebra library would disturb the tick; pydantic's search for plug-ins costs 50 ms.
ENVIRONMENT: Final = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "PYDANTIC_DISABLE_PLUGINS": "__all__",
}


@dataclass(slots=True)
class Spawned:
    """A control process that waits for its setup, and the write end of its pipe."""

    process: subprocess.Popen[bytes]
    pipe: int


def spawn() -> Spawned:
    """Start ``python -m contid.control.process``."""
    inside, pipe = os.pipe()
    command = module_command("contid.control.process", str(inside), str(os.getpid()))
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
