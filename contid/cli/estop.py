"""``contid estop``: see `contid.cli.orders`."""

from __future__ import annotations

from contid.cli.orders import order

command = order("estop", "Relax or vent at once, as the robot file says under stop.estop. Anybody may.")
