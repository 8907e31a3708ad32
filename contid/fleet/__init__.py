"""Robots beyond one machine, on Eclipse Zenoh: a bridge per machine, and its operators. See docs/fleet.md.

The network carries the protocol of the socket, and the lease stays in the daemon. Only `contid.fleet.net`
imports zenoh (extra ``contid[fleet]``).
"""
