"""``contid session``: what is done with a recording."""

from __future__ import annotations

from typing import Final

from contid.cli.support.table import TableGroup

#: Command -> (module:attribute, one line for ``contid session --help``).
SESSIONS: Final[dict[str, tuple[str, str]]] = {
    "info": ("contid.cli.commands.session.summary:info", "duration, ticks, robots, faults, events, versions"),
    "repair": ("contid.cli.commands.session.summary:repair", "a truncated recording"),
}

command = TableGroup(
    SESSIONS, "Sessions", "session", help="Summarise, check, export or repair a recorded session."
)
