"""Any table becomes a trajectory: read, give meaning, place, check."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "adapt": ("contid_adapt.command", "a trajectory from the table of another program or tracker"),
}
