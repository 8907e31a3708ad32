"""``contid estop``: see `contid.cli.support.orders`."""

from __future__ import annotations

from contid.cli.support.orders import order

command = order("estop", "Relax or vent at once, as the robot file says under stop.estop. Anybody may.")
