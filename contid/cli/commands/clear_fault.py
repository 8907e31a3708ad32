"""``contid clear-fault``: see `contid.cli.support.orders`."""

from __future__ import annotations

from contid.cli.support.orders import order

command = order(
    "clear_fault",
    "Clear the devices' faults, look at everything again and leave FAULT. Never moves; resume arms.",
)
