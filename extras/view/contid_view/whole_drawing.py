"""Drawings that are written whole or not at all: Rerun writes by name, so it gets another one."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from contid_view.view_target import ViewError


@contextmanager
def whole_drawing(path: Path) -> Iterator[Path]:
    """The path of a new file that replaces ``path`` when it is whole; a device is written directly.

    Raises:
        ViewError: the file cannot be written; an existing one is unchanged.
    """
    if path.exists() and not path.is_file():
        yield path
        return
    target = Path(os.path.realpath(path))
    part = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        yield part
        part.replace(target)
    except ViewError as error:
        raise ViewError(str(error).replace(str(part), str(path))) from error
    except OSError as error:
        raise ViewError(f"{path}: cannot write it: {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)
