"""Recordings replayed, checked against the rules of motion, for other programs, and on one clock."""

from __future__ import annotations

from typing import Final

_EXPORT: Final = "contid_sessions.export_command"
#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "replay": (
        "contid_sessions.replay.command",
        "run a recording through today's code and compare every command",
    ),
    "session": ("contid_sessions.group", "a recording: summary, check, export, repair"),
    "session check": (
        "contid_sessions.check_command",
        "the motion against the rules, from records alone",
    ),
    "session export": (
        f"{_EXPORT}:export",
        "as CSV, Parquet, HDF5, for viewers, or its robot file",
    ),
    "session list": ("contid_sessions.list_command", "the recordings of a folder, the newest first"),
    "session repair": ("contid_sessions.repair_command:repair", "a truncated recording"),
    "session lerobot": (f"{_EXPORT}:lerobot", "recordings as a LeRobot dataset, an episode each"),
    "session merge": (f"{_EXPORT}:merge", "sessions of a fleet run on one clock"),
}
