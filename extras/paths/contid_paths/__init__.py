"""Paths: shapes as trajectories for a robot, and the fastest timing of a path."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "path": ("contid_paths.command", "print a trajectory: circle, line, square, spiral and others"),
    "retime": ("contid_paths.command:retime", "the fastest timing of a trajectory within all limits"),
}
