"""Devices at the ports of a robot file: servos as their manual has them, the firmware of boards."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "emulate": ("contid_emulate.command", "wire-level devices on ptys: the real drivers without hardware"),
}
