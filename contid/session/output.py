"""Files of recordings: private, and never overwritten."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from contid.errors import ContidError
from contid.session.format.mcap_records import MAGIC

#: Sessions and command logs hold everything a robot did: for their owner only.
PRIVATE: Final = 0o600


def exists_error(path: Path) -> ContidError:
    """The error for a recording that would be overwritten."""
    return ContidError(f"{path}: file exists; recordings are never overwritten")


def refuse_recording(path: Path) -> None:
    """Recordings are never overwritten, by exports neither.

    Raises:
        ContidError: the file is a recording.
    """
    if path.is_file():
        with path.open("rb") as file:
            if file.read(len(MAGIC)) == MAGIC:
                raise exists_error(path)
