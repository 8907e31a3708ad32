"""Drawing a running robot or a session with Rerun, in a process that the control loop never waits for."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "view": ("contid_view.command", "show a recording: robots, axes, events"),
    "shape": (
        "contid_view.shape_command",
        "backbone points from actuation rows, or from measured poses of the tip",
    ),
}
