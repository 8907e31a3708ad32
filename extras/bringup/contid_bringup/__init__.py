"""Bring-up: the wiring of every axis is proven with bounded energy before a loop closes on it."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "bringup": ("contid_bringup.command", "prove the wiring of every axis before it moves"),
}
