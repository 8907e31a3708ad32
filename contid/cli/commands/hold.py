"""``contid hold``: see `contid.cli.support.orders`."""

from __future__ import annotations

from contid.cli.support.orders import order

command = order("hold", "Stop with limited jerk and stay. Anybody may, whoever moves the robots.")
