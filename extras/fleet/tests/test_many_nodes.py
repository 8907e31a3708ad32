"""Fifty nodes behind slow links, and a daemon that does not answer; the network is a stand-in."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from contid.client import AsyncClient
from contid.remote.protocol.wire import Fields
from contid_fleet import node as node_module
from contid_fleet.clocks import ClockOffset
from contid_fleet.conductor import _Conductor
from contid_fleet.fleet_file import MachineFile
from contid_fleet.keys import Keys, Origin
from contid_fleet.links.operator_links import OperatorLinks
from contid_fleet.net import NetSession
from contid_fleet.node import Node
from contid_fleet.operator import FleetOperator
from contid_fleet.sessions import Sessions

NODES = 50
#: Time that one request takes.
TRIP_S = 0.02


class SlowClient:
    """A node that is started at a time."""

    started: tuple[int, float] | None = None

    async def request(self, verb: str, **fields: Any) -> Fields:
        await asyncio.sleep(TRIP_S)
        return {}

    async def start(self, move: int, at_s: float) -> Fields:
        await asyncio.sleep(TRIP_S)
        self.started = move, at_s
        return {}


def test_fifty_nodes_confirm_a_start_in_time() -> None:
    clients = {f"hand{n}": SlowClient() for n in range(NODES)}
    operator = cast(FleetOperator, SimpleNamespace(origin=Origin("anna", "session")))
    conductor = _Conductor(operator, cast(dict[str, AsyncClient], clients), {}, 1.0, lambda step: None)
    conductor._moves = dict.fromkeys(clients, 7)
    offsets = {name: ClockOffset(float(n), 0.001) for n, name in enumerate(clients)}
    at_s = asyncio.run(conductor._start(offsets))
    assert [client.started for client in clients.values()] == [(7, at_s + n) for n in range(NODES)]
    assert at_s > time.monotonic()


class PingedClient:
    """A node with a lease; one that hangs never answers."""

    def __init__(self, hangs: bool) -> None:
        self._hangs, self.pings = hangs, 0

    async def ping(self) -> None:
        self.pings += 1
        if self._hangs:
            await asyncio.get_running_loop().create_future()


def test_a_node_that_hangs_costs_no_other_its_lease() -> None:
    """Requests wait for their answers for ten seconds; leases may be as short as 0.3 s."""
    clients = {"hand0": PingedClient(hangs=True), "hand1": PingedClient(hangs=False)}
    operator = cast(FleetOperator, SimpleNamespace(origin=Origin("anna", "session")))
    lease_s, leases = 0.1, 5
    conductor = _Conductor(operator, cast(dict[str, AsyncClient], clients), {}, lease_s, lambda step: None)

    async def keep() -> None:
        async with asyncio.timeout(leases * lease_s):
            await conductor._keep_leases()

    with pytest.raises(TimeoutError):
        asyncio.run(keep())
    assert clients["hand1"].pings >= 2 * leases


def test_a_stop_of_a_daemon_that_does_not_answer_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def silent(verb: str, fields: Fields) -> Fields:
        return await asyncio.Event().wait() and {}

    async def stop() -> Fields:
        machine, net = cast(MachineFile, None), cast(NetSession, None)
        node = Node("hand1", tmp_path / "s", machine, net, Keys("lab"), Sessions())
        node._links = cast(OperatorLinks, SimpleNamespace(link=lambda origin: None))
        node._watch = cast(Any, SimpleNamespace(request=silent))
        async with asyncio.timeout(60.0):
            return await node._stop(Origin("anna", "session"), "estop", {})

    monkeypatch.setattr(node_module, "STOP_TIMEOUT_S", 0.05)
    response = asyncio.run(stop())
    assert response["error"]["code"] == "no-answer"
