"""Rows for robots: shapes as trajectories, the fastest timing of a path, rows through the kinematics."""

from __future__ import annotations

from typing import Final

_KINEMATICS: Final = "contid_paths.kinematics_command"
#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "path": ("contid_paths.command", "print a trajectory: circle, line, square, spiral and others"),
    "fk": (f"{_KINEMATICS}:fk", "actuation rows to tip positions"),
    "ik": (f"{_KINEMATICS}:ik", "target rows to actuation"),
    "retime": ("contid_paths.command:retime", "the fastest timing of a trajectory within all limits"),
}
