"""The bridge of a machine, `contid fleet serve`: carries the protocol of its daemons' sockets to the network.

It never refreshes a lease: only requests of an operator do. When the operator, the network or this process
stands still, the lease lapses in the daemon and the robots hold.
"""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from contid.errors import ContidError
from contid.remote.protocol.socket_path import running
from contid_fleet.feed_watch import FeedWatch
from contid_fleet.fleet_file import MachineFile
from contid_fleet.keys import Keys, is_node_name
from contid_fleet.metrics_server import MetricsServer
from contid_fleet.metrics_text import MetricsText, bridge_text, nodes_text
from contid_fleet.net import FleetError, NetSession, in_loop
from contid_fleet.net_settings import NetSettings
from contid_fleet.node import Node
from contid_fleet.sessions import Sessions

log = logging.getLogger(__name__)

#: Period of the search for further daemons, when the file names none.
SEARCH_PERIOD_S: Final = 1.0
#: Period of the look whether the feed of an operator has stopped.
FEED_LOOK_S: Final = 0.01
#: How long the start waits for tokens of nodes with the same names.
RIVALS_TIMEOUT_S: Final = 0.5
#: One attempt to link with a router.
ROUTER_TIMEOUT_S: Final = 1.0


def network(machine: MachineFile) -> NetSettings:
    """How a machine is linked: operators connect to it, or it connects to a router."""
    access = None if machine.tls is None else machine.access_rules()
    if not machine.connect:
        return NetSettings(machine.listen, tls=machine.tls, access=access)
    return NetSettings(
        connect=machine.connect,
        tls=machine.tls,
        connect_timeout_s=ROUTER_TIMEOUT_S,
        access=access,
        mode="client",
    )


def _linked(machine: MachineFile) -> FleetBridge:
    """A bridge once its router is there.

    Raises:
        FleetError: it has none, and cannot listen.
    """
    waiting = False
    while True:
        try:
            return FleetBridge(machine)
        except FleetError as error:
            if not machine.connect:
                raise
            if not waiting:
                log.warning("waiting for the router: %s", error)
            waiting = True


class FleetBridge:
    """All nodes of a machine in one session.

    Raises:
        FleetError: from the constructor: an endpoint cannot be used.
    """

    def __init__(self, machine: MachineFile) -> None:
        self._machine = machine
        self._keys = Keys(machine.fleet)
        self._net = NetSession(network(machine))
        self._nodes: dict[str, Node] = {}
        self._running: dict[str, asyncio.Task[None]] = {}
        self._sessions = Sessions()
        feed = machine.hold_without_feed
        self._feed = None if feed is None else FeedWatch(feed.operator, feed.after_s)
        self._tasks: set[asyncio.Task[None]] = set()

    async def serve(self, ready: Callable[[], None], metrics: tuple[str, int] | None = None) -> None:
        """Serve until SIGINT or SIGTERM; ``metrics`` is where the page for Prometheus is served.

        Raises:
            FleetError: another bridge has one of the nodes already.
        """
        page = MetricsServer(self.metrics)
        loop, end = asyncio.get_running_loop(), asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, end.set)
        try:
            if metrics is not None:
                await page.start(*metrics)
            await self._refuse_rivals()
            self._net.watch_tokens(self._keys.who("*", "*"), in_loop(loop, self._who))
            self._net.watch_tokens(self._keys.alive("*", "*"), in_loop(loop, self._alive))
            self._begin()
            if self._feed is not None:
                self._tasks.add(asyncio.create_task(self._watch_feed(self._feed)))
            ready()
            while not end.is_set():
                self._check()
                try:
                    async with asyncio.timeout(SEARCH_PERIOD_S):
                        await end.wait()
                except TimeoutError:
                    self._begin()
        finally:
            page.close()
            for task in (*self._running.values(), *self._tasks):
                task.cancel()
            await asyncio.gather(*self._running.values(), *self._tasks, return_exceptions=True)
            await asyncio.to_thread(self._net.close)

    async def metrics(self) -> str:
        """The page for Prometheus."""
        nodes = dict(self._nodes)
        found = await asyncio.gather(*(node.status() for node in nodes.values()))
        metrics = MetricsText()
        nodes_text(metrics, dict(zip(nodes, found, strict=True)))
        bridge_text(metrics, nodes)
        return metrics.text()

    def _sockets(self) -> dict[str, Path]:
        """Socket by name of the node."""
        if self._machine.nodes:
            return self._machine.nodes
        found = {path.name.removesuffix(".sock"): path for path in reversed(running())}
        return {name: path for name, path in sorted(found.items()) if is_node_name(name)}

    def _begin(self) -> None:
        for name, path in self._sockets().items():
            if name not in self._nodes:
                node = Node(name, path, self._machine, self._net, self._keys, self._sessions, self._feed)
                self._nodes[name] = node
                self._running[name] = asyncio.create_task(node.run())

    async def _watch_feed(self, watch: FeedWatch) -> None:
        while True:
            await asyncio.sleep(FEED_LOOK_S)
            if watch.lapsed(time.monotonic()):
                log.error("the feed of %s has stopped: every robot of this machine holds", watch.operator)
                for node in self._nodes.values():
                    task = asyncio.create_task(node.hold())
                    self._tasks.add(task)
                    task.add_done_callback(self._tasks.discard)

    def _check(self) -> None:
        """An error of one node must not go unnoticed."""
        for task in self._running.values():
            if task.done():
                task.result()

    async def _refuse_rivals(self) -> None:
        for name in self._sockets():
            key = self._keys.alive(name, "*")
            found = await asyncio.to_thread(self._net.tokens, key, RIVALS_TIMEOUT_S)
            if found:
                raise FleetError(
                    f"node {name!r} is in fleet {self._machine.fleet!r} already (bridge "
                    f"{found[0].rpartition('/')[2]}); give this one another name: nodes: {{NAME: SOCKET}}"
                )

    def _who(self, key: str, alive: bool) -> None:
        origin = self._keys.origin(key)
        if origin is None:
            return
        self._sessions.change(origin, alive)
        if not alive:
            for node in self._nodes.values():
                node.session_ended(origin)

    def _alive(self, key: str, alive: bool) -> None:
        name, bridge = self._keys.alive_node(key) or ("", "")
        if name in self._nodes and bridge != self._net.name:
            self._nodes[name].rival(bridge, alive)


def serve(machine: MachineFile, ready: Callable[[], None], metrics: tuple[str, int] | None = None) -> None:
    """Serve until SIGINT or SIGTERM; ``ready`` is called when operators can connect.

    Raises:
        ContidError: it cannot start, or an error of a node.
    """
    os.umask(0o077)  # Unix sockets of Zenoh are for this user
    bridge = _linked(machine)
    try:
        asyncio.run(bridge.serve(ready, metrics))
    except OSError as error:
        raise ContidError(f"the bridge: {error.strerror or error}") from error
