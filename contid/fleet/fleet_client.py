"""The client of one node over the network: the procedures of `contid.client` with other I/O."""

from __future__ import annotations

import queue
import time
from pathlib import Path
from typing import Final, Self

from contid.fleet.net import FleetError
from contid.fleet.operator import FleetOperator
from contid.fleet.operator_link import LEASE_S
from contid.remote.client.client_protocol import Request
from contid.remote.client.procedures import Procedures
from contid.remote.protocol.wire import Fields, decode, encode

#: How long a node may take to appear after this session was opened.
APPEAR_TIMEOUT_S: Final = 1.0
POLL_S: Final = 0.01
#: How long to wait for a response, if its verb takes no longer.
RESPONSE_TIMEOUT_S: Final = 5.0


class FleetProcedures(Procedures):
    """The procedures over a session on the network: no coroutine of this class ever suspends.

    Moving needs `acquire` first: by network no order takes a free lease by itself.

    Args:
        operator: the session; it stays open.
        node: name of the node.

    Raises:
        FleetError: from `connect`: no such node, or two of this name.
    """

    def __init__(self, operator: FleetOperator, node: str) -> None:
        super().__init__(None, name=f"fleet {operator.origin.operator}", timeout_s=RESPONSE_TIMEOUT_S)
        self.path = Path(node)
        self._operator = operator
        self._node = node
        self._lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._client: int | None = None

    async def connect(self) -> Self:
        """Wait for the node, and receive its notices."""
        deadline_s = time.monotonic() + APPEAR_TIMEOUT_S
        while not (count := self._operator.nodes().get(self._node, 0)):
            if time.monotonic() > deadline_s:
                there = ", ".join(sorted(self._operator.nodes())) or "none"
                raise FleetError(f"no node {self._node!r} in this fleet; there are: {there}")
            time.sleep(POLL_S)
        if count > 1:
            raise FleetError(f"{count} nodes have the name {self._node!r}: give one of them another name")
        key = self._operator.keys.notices(self._node, self._operator.origin)
        self._operator.net.subscribe(key, lambda _, line: self._lines.put(line))
        self.hello = {}
        return self

    async def acquire(self, timeout_s: float = LEASE_S, *, takeover: bool = False) -> Fields:
        """Acquire the lease; a connection that is made anew later ends this client."""
        self._client = None
        return await super().acquire(timeout_s, takeover=takeover)

    async def _open(self, path: Path) -> None:
        raise NotImplementedError("`connect` does it")

    async def _exchange(self, request: Request) -> Fields:
        verb = str(decode(request.line)["verb"])
        response = self._operator.ask(self._node, verb, request.fields, request.timeout_s)
        if response is None:
            raise self._protocol.lost(
                f"{self._node}: no response to {verb} within {request.timeout_s:g} s (a machine with TLS "
                "answers nothing that its file does not allow this operator)"
            )
        number = response.pop("client", None)
        if verb == "acquire":
            self._client = number
        elif None not in (number, self._client) and number != self._client:
            raise self._protocol.lost(f"{self._node}: its bridge or its daemon lost this session")
        self._protocol.receive(encode({"id": request.number, **response}))
        result = self._protocol.result(request)
        assert result is not None
        return result

    async def _wait_notice(self, seconds: float) -> None:
        try:
            self._protocol.receive(self._lines.get(timeout=max(seconds, 0.001)) + b"\n")
        except queue.Empty:
            return
        if self._protocol.close_reason:
            raise self._protocol.lost(self._protocol.close_reason)

    async def _sleep(self, seconds: float) -> None:
        time.sleep(seconds)

    async def _disconnect(self) -> None:
        """The session belongs to the operator."""
