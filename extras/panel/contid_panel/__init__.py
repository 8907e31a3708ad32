"""The panel: a page in the browser that shows and moves the robots of a running daemon, over its socket."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "panel": ("contid_panel.commands", "a page in the browser: STOP, state, jogging, trajectories"),
    "demo": ("contid_panel.commands:demo", "a robot on simulated devices, in the browser"),
}
