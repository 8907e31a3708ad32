"""Writing a file completely or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from contid.errors import ContidError


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A temporary file that replaces ``path`` in one step when it is complete; devices are written directly.

    Raises:
        ContidError: the file cannot be written; an existing one is unchanged.
    """
    device = path.exists() and not path.is_file()
    target = path if device else path.resolve()
    part = path if device else target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        with part.open("wb") as file:
            yield file
            file.flush()
            if not device:
                os.fsync(file.fileno())
        if not device:
            part.replace(target)
    except BaseException as error:
        if not device:
            part.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise ContidError(f"{path}: cannot write it: {error.strerror}") from error
        raise


def exists_error(path: Path) -> ContidError:
    """The error for a recording that would be overwritten."""
    return ContidError(f"{path}: file exists; recordings are never overwritten")
