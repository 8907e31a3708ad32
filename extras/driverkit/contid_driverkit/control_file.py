"""Control file of an emulator: a text file to which fault switches are appended, one JSON object per line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from contid.errors import ContidError


class ControlFile:
    """Applies the lines appended to a file since it was created.

    Args:
        path: path of the file.
        apply: sets the switch of one decoded line; an error of it refuses the line.
    """

    def __init__(self, path: Path, apply: Callable[[Any], None]) -> None:
        self._path = path
        self._apply = apply
        path.touch()
        self._at = path.stat().st_size

    def poll(self) -> None:
        """Apply whole lines added since the last call; refused ones go to ``PATH.errors``."""
        if not self._path.exists() or self._path.stat().st_size <= self._at:
            return
        with self._path.open("rb") as file:
            file.seek(self._at)
            data = file.read()
        whole = data[: data.rfind(b"\n") + 1]
        self._at += len(whole)
        for line in whole.decode(errors="replace").splitlines():
            if not line.strip():
                continue
            try:
                self._apply(json.loads(line))
            except ValidationError as error:
                self._refuse(line, "; ".join(_text(found) for found in error.errors()))
            except (ContidError, ValueError, TypeError) as error:
                self._refuse(line, str(error))

    def _refuse(self, line: str, why: str) -> None:
        with self._path.with_name(self._path.name + ".errors").open("a") as errors:
            errors.write(f"{line.strip()}: {why}\n")


def _text(found: Any) -> str:
    place = ".".join(map(str, found["loc"]))
    return f"{place}: {found['msg']}" if place else str(found["msg"])
