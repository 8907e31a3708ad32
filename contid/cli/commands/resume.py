"""``contid resume``: see `contid.cli.support.orders`."""

from __future__ import annotations

from contid.cli.support.orders import order

command = order("resume", "Arm and go on with what was followed. After FAULT use clear-fault first.")
