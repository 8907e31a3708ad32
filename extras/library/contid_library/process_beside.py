"""A process beside a run: it ends with the run, which never waits for it before."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final

#: How long the end of a run waits for the end of the process.
EXIT_TIMEOUT_S: Final = 5.0


@contextmanager
def process_beside(command: Sequence[str], stdout: int | None = None) -> Iterator[subprocess.Popen[bytes]]:
    """Start a command whose stdin is closed when it is to end; one that does not end is killed.

    Args:
        command: reads its stdin to the end, and ends then.
        stdout: as in `subprocess.Popen`.
    """
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=stdout,
        # Ctrl-C in a terminal is for the daemon, which decides how the run ends.
        start_new_session=True,
    )
    assert process.stdin is not None
    try:
        yield process
    finally:
        process.stdin.close()
        try:
            process.wait(EXIT_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
