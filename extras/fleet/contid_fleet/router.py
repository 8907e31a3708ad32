"""The router of a fleet, `contid fleet route`: operators and machines link with it, not with each other.

It passes on messages that the access rules allow, and has no part in the protocol: a lease, a stop and a
token go through it as they are. When it dies or falls silent, bridges lose the tokens of operators.
"""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Callable
from typing import Any, Self

from pydantic import Field, model_validator

from contid_fleet.access_rules import router_rules
from contid_fleet.certificates import MACHINE
from contid_fleet.fleet_file import FleetFile, Listen, Name, NodeName, check_names
from contid_fleet.keys import Keys
from contid_fleet.net import NetSession
from contid_fleet.net_settings import NetSettings
from contid_fleet.rights import Right

log = logging.getLogger(__name__)


class RouterFile(FleetFile):
    """What `contid fleet route` passes on.

    Attributes:
        listen: endpoints for operators and machines.
        machines: names of the nodes by name of the machine's certificate.
        operators: rights by name of the operator; those of a machine's own file apply as well.
        trust_local_users: as in the file of a machine.
    """

    listen: list[Listen] = Field(min_length=1, max_length=16)
    machines: dict[Name, list[NodeName]] = Field(min_length=1, max_length=256)
    operators: dict[Name, list[Right]] = Field(default_factory=dict, max_length=256)
    trust_local_users: bool = False

    def endpoints(self) -> list[str]:
        """Every endpoint of the file."""
        return self.listen

    def access_rules(self) -> dict[str, Any]:
        """The access rules of the router: machines are named by the common names of their certificates."""
        machines = {f"{MACHINE}{name}": nodes for name, nodes in self.machines.items()}
        return router_rules(self.fleet, self.operators, machines)

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        if self.connect:
            raise ValueError("connect: a router listens only; machines and operators connect to it")
        owners: dict[str, str] = {}
        for machine, nodes in self.machines.items():
            for node in nodes:
                if owners.setdefault(node, machine) != machine:
                    raise ValueError(f"machines: node {node!r} is at {owners[node]!r} and at {machine!r}")
        check_names(self.endpoints(), self.operators, self.trust_local_users)
        return self


def route(file: RouterFile, ready: Callable[[], None]) -> None:
    """Route until SIGINT or SIGTERM; ``ready`` is called when machines and operators can connect.

    Raises:
        FleetError: an endpoint cannot be listened on.
    """
    os.umask(0o077)  # Unix sockets of Zenoh are for this user
    # Blocked before Zenoh starts its threads: one of them could take the signal, and this one would sleep on.
    ends = {signal.SIGINT, signal.SIGTERM}
    signal.pthread_sigmask(signal.SIG_BLOCK, ends)
    access = None if file.tls is None else file.access_rules()
    net = NetSession(NetSettings(file.listen, tls=file.tls, access=access, mode="router"))
    try:
        keys = Keys(file.fleet)

        def note(key: str, alive: bool) -> None:
            node, bridge = keys.alive_node(key) or ("", "")
            log.info("node %s %s (bridge %s)", node, "is there" if alive else "is gone", bridge)

        net.watch_tokens(keys.alive("*", "*"), note)
        ready()
        signal.sigwait(ends)
    finally:
        net.close()
