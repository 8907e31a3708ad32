"""Robots in motion: rods with mass and damping, their modes."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "modes": ("contid_dynamics.command", "frequencies, damping and shapes of a robot's body"),
}
