"""``contid hold``: see `contid.cli.orders`."""

from __future__ import annotations

from contid.cli.orders import order

command = order("hold", "Stop with limited jerk and stay. Anybody may, whoever moves the robots.")
