"""Starts the control process before the daemon imports anything heavy, so that both import in parallel."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final


def module_command(module: str, *arguments: str) -> list[str]:
    """The command that runs a module in the interpreter, and from the package, of this process.

    ``python -m`` looks in the working directory first. A checkout there has no compiled kernels, and a script
    there may have the name of a module of the standard library; neither is what this process imported.
    """
    safe_path = [] if _in_working_directory() else ["-P"]
    return [sys.executable, *safe_path, "-m", module, *arguments]


def _in_working_directory() -> bool:
    """True for a package that is perhaps found nowhere else: a checkout that is not installed."""
    with suppress(FileNotFoundError):  # a working directory that was removed
        return Path(__file__).parents[3] == Path.cwd()
    return False


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
