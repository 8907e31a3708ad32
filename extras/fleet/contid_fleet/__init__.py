"""Robots beyond one machine, on Eclipse Zenoh: a bridge per machine, and its operators. See docs/fleet.md.

The network carries the protocol of the socket, and the lease stays in the daemon. Only `contid_fleet.net`
imports zenoh (extra ``contid[fleet]``).
"""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {"fleet": ("contid_fleet.commands", "robots on several machines: one table, one stop")}
