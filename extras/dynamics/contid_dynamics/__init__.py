"""Robots in motion: rods with mass and damping, their modes, models for other simulators."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "export": ("contid_dynamics.export_command", "a robot as a model for other simulators"),
    "lead": ("contid_dynamics.lead_command", "a trajectory that makes up for the robot's lag"),
    "modes": ("contid_dynamics.command", "frequencies, damping and shapes of a robot's body"),
}
