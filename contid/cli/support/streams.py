"""Standard streams that are closed, full, broken, or in a narrow encoding.

The next file or socket that is opened would get the number of a closed descriptor 0, 1 or 2, and messages for
the terminal would end up in a recording.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from typing import TextIO


def open_closed_streams() -> None:
    """Open closed streams to ``/dev/null``; escape characters the encoding cannot write."""
    for number, mode in ((0, os.O_RDONLY), (1, os.O_WRONLY), (2, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            # The lowest free number is used, which is this one; child processes inherit it.
            opened = os.open(os.devnull, mode)
            if opened != number:
                os.dup2(opened, number)
                os.close(opened)
            os.set_inheritable(number, True)
    if sys.stdin is None:
        sys.stdin = os.fdopen(0, encoding="utf-8", closefd=False)
    if sys.stdout is None:
        sys.stdout = os.fdopen(1, "w", encoding="utf-8", closefd=False)
    if sys.stderr is None:
        sys.stderr = os.fdopen(2, "w", encoding="utf-8", closefd=False)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def print_error(message: str) -> None:
    """One message on stderr; a stderr that cannot be written is ignored."""
    with suppress(OSError):
        sys.stderr.write(f"contid: {message}\n")
        sys.stderr.flush()


def flush_stdout(code: int) -> int:
    """Write the buffered output; the exit code, 2 when it could not be written.

    A closed pipe (``| head``) is no failure.
    """
    try:
        sys.stdout.flush()
    except OSError as error:
        if error.errno != errno.EPIPE:
            print_error(system_error_message(error))
            code = code or 2
        _discard(sys.stdout)
    return code


def system_error_message(error: OSError) -> str:
    """The message of an error of the operating system that no command converted."""
    if error.errno in (errno.EMFILE, errno.ENFILE):
        return f"{error.strerror}: raise the limit (ulimit -n) and start again"
    if error.filename is None:
        return f"cannot write the output: {error.strerror or error}; free some space or send it elsewhere"
    return f"{os.fsdecode(error.filename)}: {error.strerror or error}"


def _discard(stream: TextIO) -> None:
    """Send the buffered output to ``/dev/null``: Python would flush it again at exit, and fail."""
    with suppress(OSError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)


@contextmanager
def counting(what: str) -> Iterator[Callable[[int], None]]:
    """A spinner with a growing count on a terminal; nothing elsewhere."""
    if not sys.stderr.isatty():
        yield lambda count: None
        return
    from rich.console import Console

    with Console(stderr=True).status(what) as status:
        yield lambda count: status.update(f"{count} {what}")
