"""Stored inputs of the bad input campaign: one folder per parser, one file per input.

Each takes a way through the code that the generated ones and the others do not; `tests.campaign.guided` finds
them.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any, TypeAlias

STORED = Path(__file__).parent
#: Bytes of an input that is kept.
MAX_KEPT = 4096
#: Inputs of one parser.
MAX_FILES = 25
#: A step from one line to another: code object, and both line numbers.
Step: TypeAlias = tuple[str, str, int, int]


def stored(name: str) -> tuple[bytes, ...]:
    """The stored inputs of a parser."""
    return tuple(path.read_bytes() for path in sorted((STORED / name).glob("*")))


def steps(run: Callable[[], object]) -> set[Step]:
    """The steps in contid's own files that a call takes."""
    taken: set[Step] = set()

    def trace(frame: FrameType, event: str, argument: Any) -> Any:
        code = frame.f_code
        if "contid" not in code.co_filename or "/tests/" in code.co_filename:
            return None
        last = frame.f_lineno

        def line(frame: FrameType, event: str, argument: Any) -> Any:
            nonlocal last
            taken.add((code.co_filename, code.co_qualname, last, frame.f_lineno))
            last = frame.f_lineno
            return line

        return line

    sys.settrace(trace)
    try:
        run()
    finally:
        sys.settrace(None)
    return taken


def keep(name: str, good: Iterable[bytes], found: Iterable[bytes], run: Callable[[bytes], object]) -> int:
    """Store the shortest of the found inputs that take new steps; returns their number."""
    seen: set[Step] = set()
    for data in (*good, *stored(name)):
        seen |= steps(partial(run, data))
    count = 0
    for data in sorted({data for data in found if len(data) <= MAX_KEPT}, key=lambda data: (len(data), data)):
        taken = steps(partial(run, data))
        if not taken <= seen and len(stored(name)) < MAX_FILES:
            seen |= taken
            count += 1
            folder = STORED / name
            folder.mkdir(parents=True, exist_ok=True)
            (folder / hashlib.sha1(data, usedforsecurity=False).hexdigest()[:12]).write_bytes(data)
    return count
