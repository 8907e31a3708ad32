"""A node as an address for `contid.client`: ``Client("fleet:lab/hand1")``, ``--socket fleet:lab/hand1``."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from contid.errors import ContidError
from contid_fleet.fleet_file import load_operator_file
from contid_fleet.fleet_wire import FleetWire
from contid_fleet.keys import is_name, is_node_name
from contid_fleet.net import FleetError
from contid_fleet.operator import FleetOperator

SCHEME: Final = "fleet:"
#: How long a node may take to appear after this session was opened.
APPEAR_TIMEOUT_S: Final = 1.0
POLL_S: Final = 0.01
#: How long endpoints have to be connected, and connected sessions to list their tokens.
SETTLE_S: Final = 1.5


class FleetAddress:
    """A node in a session of an operator that stays open.

    Args:
        operator: the session.
        node: name of the node.

    Attributes:
        name: ``fleet:FLEET/NODE``.
    """

    def __init__(self, operator: FleetOperator, node: str) -> None:
        self.name = f"{SCHEME}{operator.keys.fleet}/{node}"
        self._operator = operator
        self._node = node

    def open(self, deliver: Callable[[bytes], None]) -> FleetWire:
        """See `contid.remote.client.wires.Address.open`.

        Raises:
            FleetError: no such node, or two of this name.
        """
        await_node(self._operator, self._node)
        return FleetWire(self._operator, self._node, deliver)


class OperatorAddress:
    """A node, in a session that the file of an operator describes; the session ends with the wire.

    Attributes:
        name: ``fleet:FLEET/NODE``.
    """

    def __init__(self, fleet: str, node: str) -> None:
        self.name = f"{SCHEME}{fleet}/{node}"
        self._fleet = fleet
        self._node = node

    def open(self, deliver: Callable[[bytes], None]) -> FleetWire:
        """See `FleetAddress.open`.

        Raises:
            ContidError: no file of an operator, or that of another fleet.
        """
        file = load_operator_file(None)
        if file.fleet != self._fleet:
            raise ContidError(f"{self.name}: the file of this operator is that of fleet {file.fleet!r}")
        operator = FleetOperator(file)
        try:
            await_node(operator, self._node)
            return FleetWire(operator, self._node, deliver, owns=True)
        except BaseException:
            operator.close()
            raise


def address(text: str) -> OperatorAddress:
    """The address of ``fleet:FLEET/NODE``.

    Raises:
        ContidError: the text has another form.
    """
    fleet, _, node = text.removeprefix(SCHEME).partition("/")
    if not is_name(fleet) or not is_node_name(node):
        raise ContidError(f"{text!r}: fleet:FLEET/NODE is expected, such as fleet:lab/hand1")
    return OperatorAddress(fleet, node)


def await_node(operator: FleetOperator, node: str) -> None:
    """Wait until a node has a token, and every endpoint is connected or has had its time.

    A second node of the name may be behind the slower endpoint.

    Raises:
        FleetError: it does not appear, or there are two.
    """
    deadline_s = time.monotonic() + APPEAR_TIMEOUT_S
    while node not in operator.nodes() and time.monotonic() < deadline_s:
        time.sleep(POLL_S)
    settled_s = time.monotonic() + SETTLE_S
    while operator.unlinked() and time.monotonic() < settled_s:
        time.sleep(POLL_S)
    # Tokens that were reported so far may be those of the fastest link; a router that has just come up
    # may answer without those that it has already reported.
    asked = operator.net.tokens(operator.keys.alive(node, "*"), SETTLE_S)
    count = len(operator.tokens(node) | {*asked})
    if not count:
        there = ", ".join(sorted(operator.nodes())) or "none"
        raise FleetError(f"no node {node!r} in this fleet; there are: {there}")
    if count > 1:
        raise FleetError(f"{count} nodes have the name {node!r}: give one of them another name")
