"""Repair of a session: a truncated one gets an end and an index, a damaged one a copy of its valid part."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from contid.session.compact import compact
from contid.session.format.entries import DAMAGED, GROWING
from contid.session.info import summarize
from contid.session.read import Session, SessionError


def repair(source: Path, output: Path | None, progress: Callable[[int], None] = lambda ticks: None) -> str:
    """Rewrite a session; a complete one is unchanged unless ``output`` is given.

    Args:
        source: the session.
        output: a file that does not exist; None replaces ``source``.
        progress: called with the number of ticks read.

    Returns:
        A line for the user.

    Raises:
        ContidError: it is still being recorded; it is damaged inside and ``output`` is None; ``output``
            exists or cannot be written.
    """
    session = Session(source, progress)
    before = summarize(session)
    end = session.end
    if end.clean and end.chunked and output is None:
        return f"{source}: nothing to repair"
    if end.cut == GROWING:
        raise SessionError(f"{source}: {GROWING}; nothing to repair before the run has ended")
    if end.cut == DAMAGED and output is None:
        raise SessionError(
            f"{source}: {DAMAGED} after {before.ticks} ticks ({end.damage}); give --output for a copy of the "
            "part before it; this file keeps the rest"
        )
    when = datetime.now(UTC).isoformat(timespec="seconds")
    note = {} if end.clean else {"repaired": {"when": when, "found": end.cut}}
    target = compact(source, output, note, before.ticks if end.cut == DAMAGED else None)
    after = summarize(Session(target, progress))
    return f"{target}: {after.ticks} of {before.ticks} ticks, {after.state}"
