"""``contid session``: what is done with a recording."""

from __future__ import annotations

from typing import Final

from contid.cli.support.table import TableGroup

_SUMMARY: Final = "contid.cli.commands.session.summary"
_EXPORT: Final = "contid.cli.commands.session.export"
#: Command -> (module:attribute, one line for ``contid session --help``).
SESSIONS: Final[dict[str, tuple[str, str]]] = {
    "info": (f"{_SUMMARY}:info", "duration, ticks, robots, faults, events, versions"),
    "check": (f"{_SUMMARY}:check", "the motion against the rules, from the records alone"),
    "export": (f"{_EXPORT}:export", "as CSV, Parquet, HDF5, for Rerun or Foxglove, or its robot file"),
    "lerobot": (f"{_EXPORT}:lerobot", "recordings as a LeRobot dataset, an episode each"),
    "merge": (f"{_EXPORT}:merge", "sessions of a fleet run on one clock"),
    "repair": (f"{_SUMMARY}:repair", "a truncated recording"),
}

command = TableGroup(
    SESSIONS, "Sessions", "session", help="Summarise, check, export or repair a recorded session."
)
