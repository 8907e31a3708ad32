"""The three standard streams, whatever the shell made of them: closed, full, gone, or in a narrow encoding.

A closed descriptor 0, 1 or 2 is dangerous beyond its own stream: the next file or socket that is opened gets
its number, and words meant for the terminal end up in a recording.
"""

from __future__ import annotations

import errno
import os
import sys
from contextlib import suppress
from io import TextIOWrapper
from typing import TextIO


def stand_in() -> None:
    """Open what is closed to ``/dev/null``, and let no character be one that cannot be written."""
    for number, mode in ((0, os.O_RDONLY), (1, os.O_WRONLY), (2, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            # Python numbers from the lowest that is free, which is this one; children inherit it too.
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


def tell(message: str) -> None:
    """One message on stderr; a stderr that takes nothing is no reason to fail in another way."""
    with suppress(OSError):
        sys.stderr.write(f"contid: {message}\n")
        sys.stderr.flush()


def finish(code: int) -> int:
    """Write what is left of the output; the exit code, 2 when it could not be written.

    A reader that went away (``| head``) is no failure.
    """
    try:
        sys.stdout.flush()
    except OSError as error:
        if error.errno != errno.EPIPE:
            tell(unwritten(error))
            code = code or 2
        give_up(sys.stdout)
    return code


def unwritten(error: OSError) -> str:
    """What an error of the operating system means that no command has put into words."""
    if error.errno in (errno.EMFILE, errno.ENFILE):
        return f"{error.strerror}: raise the limit (ulimit -n) and start again"
    if error.filename is None:
        return f"cannot write the output: {error.strerror or error}; free some space or send it elsewhere"
    return f"{os.fsdecode(error.filename)}: {error.strerror or error}"


def give_up(stream: TextIO) -> None:
    """Send what a stream still holds to ``/dev/null``: Python would try again, and fail, when it ends."""
    with suppress(OSError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)
