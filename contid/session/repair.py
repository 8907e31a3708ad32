"""Making a session whole: what was cut off gets its end and an index, a copy leaves damage inside out."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from contid.session.compact import compact
from contid.session.format.entries import DAMAGED, GROWING
from contid.session.info import summarize
from contid.session.read import Session, SessionError


def repair(source: Path, output: Path | None, progress: Callable[[int], None] = lambda ticks: None) -> str:
    """Rewrite a session; a whole one is left alone, unless it is to be written elsewhere.

    Args:
        source: the session.
        output: where to, a file that does not exist; None replaces ``source``.
        progress: called with the number of ticks read.

    Returns:
        What was done, in words.

    Raises:
        ContidError: it is still being recorded; replacing it would lose what follows some damage; ``output``
            exists, or cannot be written.
    """
    session = Session(source, progress)
    before = summarize(session)
    if session.clean and session.chunked and output is None:
        return f"{source}: nothing to repair"
    if session.cut == GROWING:
        raise SessionError(f"{source}: {GROWING}; there is nothing to repair before the run has ended")
    most = None
    if session.cut == DAMAGED:
        most = before.ticks
        if output is None:
            message = f"{DAMAGED} after {most} ticks; give --output for a copy of what comes before it"
            raise SessionError(f"{source}: {message}, the rest is kept here only")
    when = datetime.now(UTC).isoformat(timespec="seconds")
    note = {} if session.clean else {"repaired": {"when": when, "found": session.cut}}
    target = compact(source, output, note, most)
    after = summarize(Session(target, progress))
    return f"{target}: {after.ticks} of {before.ticks} ticks, {after.state}"
