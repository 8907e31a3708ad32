"""Reachable sets of the robots of a file: exact regions in the plane, voxel volumes in space."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "reach": ("contid_reach.command", "workspace of the tips: areas, volumes, overlaps, plots"),
}
