"""``contid clear-fault``: see `contid.cli.orders`."""

from __future__ import annotations

from contid.cli.orders import order

command = order(
    "clear_fault",
    "Clear the devices' faults, look at everything again and leave FAULT. Never moves; resume arms.",
)
