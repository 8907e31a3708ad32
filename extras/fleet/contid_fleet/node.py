"""One daemon in the fleet: its telemetry and events go out, requests of operators come in."""

from __future__ import annotations

import asyncio
import logging
import re
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Final

from contid.errors import ContidError
from contid.remote.protocol import expiry
from contid.remote.protocol.wire import Code, ConnectionLostError, Fields, RemoteError, encode
from contid_fleet.clocks import NotedOffset, clock_fields
from contid_fleet.feed_watch import FeedWatch
from contid_fleet.fleet_file import MachineFile
from contid_fleet.gate import FORBIDDEN, checked
from contid_fleet.keys import Keys, Order, Origin
from contid_fleet.links.daemon_link import DaemonLink, refusal
from contid_fleet.links.operator_links import MAX_SESSIONS, OperatorLinks
from contid_fleet.net import Declared, NetSession, Question, in_loop
from contid_fleet.order_times import OrderTimes
from contid_fleet.rights import CLOCK, FEED, LEASED, NOTE, READS, STOPS
from contid_fleet.sessions import Sessions

log = logging.getLogger(__name__)

#: Code of the bridge: two nodes have one name.
DUPLICATE: Final = "duplicate"
#: Pause before a daemon that ended is looked for again [s].
RETRY_S: Final = 1.0
#: Longest wait for one response of the daemon to `status` or `hold` [s].
STATUS_TIMEOUT_S: Final = 0.5
#: Longest wait for the response to a stop that goes by the connection of the bridge itself [s].
STOP_TIMEOUT_S: Final = 1.0
#: A hold after the end of a feed is tried at most this number of times, with this pause [s].
HOLD_ATTEMPTS: Final = 50
HOLD_PERIOD_S: Final = 0.1
#: End of a line of telemetry: frames that the daemon dropped, because this process read too slowly.
DROPPED: Final = re.compile(rb'"dropped":(\d+)}$')


class Node:
    """A daemon, as the network sees it.

    Args:
        name: name of the node.
        path: path of its socket.
        machine: rights of the operators.
        net: the session on the network.
        keys: keys of the fleet.
        sessions: sessions of operators.
        feed: that the machine needs, if it does.

    Attributes:
        rivals: other bridges that have a node of this name; while there are any it only stops.
        counts: requests by verb and result (``ok``, or the code of the refusal).
        published: frames of telemetry.
        dropped: frames that the daemon dropped, because this process did not read them in time.
        round_trip_s: time of the last question of `status` to the daemon.
        noted: newest offset of its clock that the conductor of a run noted.
        look: notes that this process runs.
    """

    def __init__(
        self,
        name: str,
        path: Path,
        machine: MachineFile,
        net: NetSession,
        keys: Keys,
        sessions: Sessions,
        feed: FeedWatch | None = None,
    ) -> None:
        self.name = name
        self.rivals: set[str] = set()
        self.counts: Counter[tuple[str, str]] = Counter()
        self.published = self.dropped = 0
        self.round_trip_s: float | None = None
        self.noted: NotedOffset | None = None
        self._path = path
        self._machine = machine
        self._net = net
        self._keys = keys
        self._sessions = sessions
        self._feed = feed
        self._links = OperatorLinks(path, sessions, self._notice)
        self._watch: DaemonLink | None = None
        self._ended = asyncio.Event()
        self._times = OrderTimes()
        self.look = self._times.look
        self._tasks: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        """Serve until cancelled; a daemon that ended is looked for again."""
        loop = asyncio.get_running_loop()
        self._net.serve(
            self._keys.do(self.name, "*", "*", "*"),
            lambda question: self._asked(question, loop),
        )
        looking = asyncio.create_task(self._look())
        try:
            while True:
                try:
                    await self._serve_daemon()
                except (ContidError, OSError, TimeoutError) as error:
                    log.debug("%s: %s", self.name, error)
                await asyncio.sleep(RETRY_S)
        finally:
            looking.cancel()
            self._links.end_all()

    async def _look(self) -> None:
        while True:
            self.look()
            await asyncio.sleep(expiry.LOOK_S)

    def session_ended(self, origin: Origin) -> None:
        """The token of a session is gone: if it held the lease, the robots hold."""
        self._links.end(origin)

    def rival(self, bridge: str, alive: bool) -> None:
        """Another bridge has, or no longer has, a node of this name."""
        if not alive:
            self.rivals.discard(bridge)
            return
        self.rivals.add(bridge)
        log.error("node %s: another bridge has this name too; both only stop until one is gone", self.name)
        self._links.end_all()

    async def hold(self) -> None:
        """Hold every robot, as a feed has stopped; repeated until the daemon confirms or has ended."""
        for _ in range(HOLD_ATTEMPTS):
            watch = self._watch
            with suppress(ContidError, TimeoutError):
                async with asyncio.timeout(STATUS_TIMEOUT_S):
                    if watch is not None and (await watch.request("hold", {})).get("ok"):
                        return
            await asyncio.sleep(HOLD_PERIOD_S)
        log.error("node %s: not held: its daemon does not answer", self.name)

    async def status(self) -> Fields | None:
        """What the daemon reports of itself, None without an answer; refreshes no lease."""
        watch, begin_s = self._watch, time.monotonic()
        if watch is None:
            return None
        try:
            async with asyncio.timeout(STATUS_TIMEOUT_S):
                found = await watch.result("status")
        except (ContidError, TimeoutError):
            return None
        self.round_trip_s = time.monotonic() - begin_s
        return found

    # -- the daemon --------------------------------------------------------------------------------------

    async def _serve_daemon(self) -> None:
        """Publish what a daemon sends, until its connection ends."""
        self._ended.clear()
        link = DaemonLink(self._path, self._publish, self._ended.set)
        await link.connect()
        token: Declared | None = None
        try:
            self._watch = link
            await link.result("hello", name="fleet")
            token = self._net.token(self._keys.alive(self.name, self._net.name))
            log.info("node %s: %s", self.name, self._path)
            subscription = {"rate_hz": self._machine.telemetry_hz, "events": True}
            await link.request("subscribe", subscription)  # refused while the robot is homed
            while not self._ended.is_set():
                self._links.end_idle()
                try:
                    async with asyncio.timeout(RETRY_S):
                        await self._ended.wait()
                except TimeoutError:
                    continue
            log.warning("node %s: its daemon ended", self.name)
        finally:
            self._watch = None
            link.close()
            if token is not None:
                token.end()

    def _publish(self, line: bytes, fields: Fields | None) -> None:
        """Publish telemetry (without fields) and events; other notices are of this connection alone."""
        if fields is None:
            self.published += 1
            if (found := DROPPED.search(line)) is not None:
                self.dropped = int(found[1])
            self._net.put(self._keys.telemetry(self.name), line)
        elif fields["event"] == "event":
            self._net.put(self._keys.event(self.name), line, urgent=True)

    def _notice(self, origin: Origin, line: bytes, urgent: bool) -> None:
        """Publish a line of the daemon for a session."""
        self._net.put(self._keys.notices(self.name, origin.operator, origin.session), line, urgent)

    # -- requests ----------------------------------------------------------------------------------------

    def _asked(self, question: Question, loop: asyncio.AbstractEventLoop) -> None:
        """In the thread of the network: a clock and a feed are answered at once, the rest in the loop."""
        until_s = self._times.until_s()
        if not question.key.endswith((f"/{CLOCK}", f"/{FEED}")):
            in_loop(loop, self._start)(question, until_s)
            return
        try:
            order, _ = checked(self._keys, question.key, question.payload, self._machine.operators)
            result = clock_fields() if order.verb == CLOCK else self._fed(order.origin.operator)
            response: Fields = {"ok": True, "result": result}
        except RemoteError as error:
            response = {"ok": False, "error": error.as_fields()}
        question.answer(self._keys.answer(question.key, self.name), encode(response)[:-1])

    def _fed(self, operator: str) -> Fields:
        """Take a feed.

        Raises:
            RemoteError: it does not count here.
        """
        feed = self._feed
        if feed is None:
            raise RemoteError(Code.REFUSED, "its machine needs no feed")
        if not feed.feed(operator, time.monotonic()):
            raise RemoteError(FORBIDDEN, f"the feed of this machine is that of {feed.operator!r}")
        return {"after_s": feed.after_s}

    def _start(self, question: Question, until_s: float) -> None:
        task = asyncio.ensure_future(self._answer(question, until_s))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _answer(self, question: Question, until_s: float) -> None:
        verb = "refused"  # not one that exists: labels of metrics are bounded
        try:
            order, fields = checked(self._keys, question.key, question.payload, self._machine.operators)
            verb = order.verb
            # The clock of the sender is not ours.
            fields.pop(expiry.FIELD, None)
            until = {expiry.FIELD: until_s} if verb in LEASED else {}
            response = await self._carry_out(order, {**fields, **until})
            if verb == NOTE and response.get("ok") and {"offset_s", "bound_s"} <= fields.keys():
                self.noted = NotedOffset.of(order.origin.operator, fields)
        except RemoteError as error:
            response = {"ok": False, "error": error.as_fields()}
        except ConnectionLostError as error:
            response = refusal(Code.NO_ANSWER, str(error))
        result = "ok" if response.get("ok") else str(response.get("error", {}).get("code", ""))
        self.counts[verb, result] += 1
        question.answer(self._keys.answer(question.key, self.name), encode(response)[:-1])

    async def _carry_out(self, order: Order, fields: Fields) -> Fields:
        verb, origin = order.verb, order.origin
        if verb in STOPS:
            return await self._stop(origin, verb, fields)
        if verb not in READS:
            if self.rivals:
                return refusal(DUPLICATE, f"another bridge has a node {self.name!r} too: this one only stops")
            if self._watch is not None and not self._watch.same_protocol:
                theirs = self._watch.hello.get("protocol")
                return refusal(Code.PROTOCOL, f"the daemon has protocol {theirs}: it only stops by network")
            if not await self._sessions.appears(origin):
                return refusal(Code.REFUSED, "this session has no token; it may only stop and read")
        link = self._links.link(origin)
        if link is None:
            return refusal(Code.REFUSED, f"{MAX_SESSIONS} sessions are connected to this node")
        return await link.request(verb, fields)

    async def _stop(self, origin: Origin, verb: str, fields: Fields) -> Fields:
        """Stop on the connection of the session, so that the daemon names its operator; else on any."""
        link = self._links.link(origin)
        if link is not None:
            response = await link.request(verb, fields)
            if response.get("error", {}).get("code") != Code.NO_ANSWER:
                return response
            self._links.end(origin)
        if self._watch is None:
            return refusal(Code.NO_ANSWER, f"no daemon listens at {self._path}")
        try:
            async with asyncio.timeout(STOP_TIMEOUT_S):
                return await self._watch.request(verb, fields)
        except TimeoutError:
            return refusal(Code.NO_ANSWER, f"the daemon did not answer within {STOP_TIMEOUT_S:g} s")
