"""Reference data of others, which the repository does not contain: `shared/data` beside it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).parents[2]
#: Names the folder where it is not beside the repository.
VARIABLE: Final = "CONTID_SHARED_DATA"


def shared_data(path: str) -> Path:
    """A file of the folder; the test that asks for it skips where it is absent."""
    folder = Path(os.environ.get(VARIABLE) or ROOT.parent / "shared" / "data")
    if not (folder / path).is_file():
        pytest.skip(
            f"no {folder / path}: recordings of others are not in the repository; {VARIABLE} names them"
        )
    return folder / path
