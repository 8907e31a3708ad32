"""An operator of a fleet: a session on the network, and questions to one node or to all."""

from __future__ import annotations

import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Final

from contid.remote.protocol.wire import Fields, RemoteError, decode, encode
from contid_fleet.fleet_file import OperatorFile
from contid_fleet.keys import Keys, Origin
from contid_fleet.net import NetSession
from contid_fleet.net_settings import NetSettings

#: A question to every node is repeated so often until every known node answered.
REPEAT_S: Final = 0.2
#: A node that has not answered after this time is reported.
ANSWER_TIMEOUT_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class Answers:
    """Responses of nodes to one question.

    Attributes:
        by_node: the whole response, refusals too.
        missing: nodes that did not answer in time.
        doubled: nodes of whose name there are several.
        unlinked: endpoints of the file without a link.
        took_s: until the last response.
    """

    by_node: Mapping[str, Fields]
    missing: tuple[str, ...]
    doubled: tuple[str, ...]
    unlinked: int
    took_s: float


class FleetOperator(AbstractContextManager["FleetOperator"]):
    """A session of an operator. Use it with ``with``.

    Attributes:
        keys: keys of the fleet.
        origin: operator and session.
        net: the session on the network.

    Raises:
        ContidError: from the constructor: no Zenoh, or wrong files of TLS.
    """

    def __init__(self, file: OperatorFile) -> None:
        self._file = file
        self.keys = Keys(file.fleet)
        self.net = NetSession(NetSettings(connect=file.connect, tls=file.tls))
        self.origin = Origin(file.operator, self.net.name)
        self._tokens: set[str] = set()
        self._leaving: list[tuple[str, Callable[[], None]]] = []
        self._token = self.net.token(self.keys.who(self.origin.operator, self.origin.session))
        self.net.watch_tokens(self.keys.alive("*", "*"), self._note_token)

    def close(self) -> None:
        """End the session; robots that it moved hold."""
        self.net.close()

    def __exit__(self, *error: object) -> None:
        """Close."""
        self.close()

    def nodes(self) -> dict[str, int]:
        """Nodes that have a token, with the number of bridges that have one: more than one is a mistake."""
        return Counter(map(self.keys.node, tuple(self._tokens)))

    def tokens(self, node: str) -> set[str]:
        """Keys of the tokens of a node that were reported, one per bridge."""
        return {key for key in tuple(self._tokens) if self.keys.node(key) == node}

    def ask(self, node: str, verb: str, fields: Mapping[str, Any], timeout_s: float) -> Fields | None:
        """The whole response of one node, None without one in time."""
        answer = self.timed_ask(node, verb, fields, timeout_s)
        return None if answer is None else answer[1]

    def timed_ask(
        self, node: str, verb: str, fields: Mapping[str, Any], timeout_s: float, urgent: bool = False
    ) -> tuple[float, Fields] | None:
        """As `ask`, with the time on the monotonic clock at which the response came [s]."""
        answers: queue.SimpleQueue[tuple[float, Fields] | None] = queue.SimpleQueue()
        self.net.ask(
            self.key(node, verb),
            encode(fields)[:-1],
            timeout_s,
            lambda _, payload: answers.put((time.monotonic(), response_of(payload))),
            lambda: answers.put(None),
            urgent=urgent,
            wait=not urgent,
        )
        try:
            return answers.get(timeout=timeout_s + ANSWER_TIMEOUT_S)
        except queue.Empty:
            return None

    def ask_all(
        self,
        verb: str,
        fields: Mapping[str, Any],
        nodes: Collection[str] = (),
        timeout_s: float = ANSWER_TIMEOUT_S,
        expected: Collection[str] | None = None,
    ) -> Answers:
        """Ask nodes, or all, until every known one has answered or the time is over.

        Args:
            verb: a stop or a read.
            fields: fields of the request.
            nodes: names; empty for every node of the fleet.
            timeout_s: when to go on without those that did not answer.
            expected: nodes that must answer besides those with a token; None for those of the file.
        """
        begin_s = time.monotonic()
        arrived: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
        found: dict[str, Fields] = {}

        def put(key: str, payload: bytes) -> None:
            arrived.put((key, payload))

        required = {*nodes} or {*(self._file.expected if expected is None else expected)}
        took_s, next_s = 0.0, begin_s
        surveyed, surveying = threading.Event(), False
        while (now_s := time.monotonic()) < begin_s + timeout_s:
            known = required if nodes else required | {*self.nodes()}
            unlinked = self.unlinked()
            confirmed = {name for name, response in found.items() if response.get("ok")}
            if known and known <= confirmed and (nodes or surveyed.is_set()):
                break
            if not unlinked and not surveying:  # every node is known only when every link has its tokens
                surveying = True
                self.net.survey(
                    self.keys.alive("*", "*"),
                    timeout_s,
                    lambda key: self._note_token(key, True),
                    surveyed.set,
                )
            if now_s >= next_s:
                next_s = now_s + REPEAT_S
                for each in sorted({*nodes} - confirmed) if nodes else ("*",):
                    key, payload = self.key(each, verb), encode(fields)[:-1]
                    self.net.ask(key, payload, timeout_s, put, urgent=True)
            try:
                key, payload = arrived.get(timeout=max(min(next_s, begin_s + timeout_s) - now_s, 0.001))
            except queue.Empty:
                continue
            name = self.keys.node(key)
            # The first confirmation counts: a repeated stop changes nothing more.
            if not found.get(name, {}).get("ok"):
                found[name] = response_of(payload)
                took_s = time.monotonic() - begin_s
        known = required if nodes else required | {*self.nodes()}
        doubled = tuple(sorted(name for name, count in self.nodes().items() if count > 1 and name in known))
        return Answers(found, tuple(sorted(known - found.keys())), doubled, self.unlinked(), took_s)

    def key(self, node: str, verb: str) -> str:
        """The key of a request of this session."""
        return self.keys.do(node, self.origin.operator, self.origin.session, verb)

    def on_leave(self, node: str, left: Callable[[], None]) -> Callable[[], None]:
        """Call ``left``, from any thread, when a node has no token any more; returns what ends that."""
        entry = node, left
        self._leaving.append(entry)

        def forget() -> None:
            if entry in self._leaving:
                self._leaving.remove(entry)

        return forget

    def unlinked(self) -> int:
        """Number of endpoints without a link."""
        return max(len(self._file.connect) - self.net.peers(), 0)

    def _note_token(self, key: str, alive: bool) -> None:
        if self.keys.alive_node(key) is None:
            return
        (self._tokens.add if alive else self._tokens.discard)(key)
        gone = self.keys.node(key)
        if not self.tokens(gone):
            for node, left in tuple(self._leaving):
                if node == gone:
                    left()


def response_of(payload: bytes) -> Fields:
    """The response of an answer; a refusal when it is none."""
    try:
        return decode(payload)
    except RemoteError as error:
        return {"ok": False, "error": error.as_fields()}
