"""A session of Zenoh with the settings of `contid_fleet.net_settings`, and nothing from the environment.

The only module that imports zenoh. What is called back runs in threads of Zenoh; `in_loop` makes a handler of
an event loop of it.
"""

from __future__ import annotations

import asyncio
import json
import os
import secrets
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from contid.errors import ContidError, require_extra
from contid_fleet.net_settings import NetSettings, configuration

if TYPE_CHECKING:
    import zenoh


def in_loop(loop: asyncio.AbstractEventLoop, handler: Callable[..., object]) -> Callable[..., None]:
    """A handler for Zenoh's threads that runs in a loop; nothing is done once the loop has ended."""

    def call(*arguments: object) -> None:
        with suppress(RuntimeError):  # the loop is closed
            loop.call_soon_threadsafe(handler, *arguments)

    return call


class FleetError(ContidError):
    """The network of the fleet cannot be used, or a node is missing."""

    exit_code = 4


@dataclass(frozen=True, slots=True)
class Question:
    """A request that came by network; it is answered once, from any thread.

    Attributes:
        key: that it was sent to.
        payload: bytes of the request.
    """

    key: str
    payload: bytes
    _query: zenoh.Query = field(repr=False)

    def answer(self, key: str, payload: bytes) -> None:
        """Send the response from ``key``; one that cannot be sent any more is dropped."""
        import zenoh

        try:
            self._query.reply(key, payload, express=True)
            self._query.drop()  # type: ignore[no-untyped-call]  # zenoh's stubs give it no type
        except zenoh.ZError:  # the session that asked is gone
            return


class Declared:
    """A token or a subscription; it lasts until its end, or that of the session."""

    def __init__(self, declared: Any) -> None:
        self._declared = declared

    def end(self) -> None:
        """End it; idempotent."""
        if self._declared is not None:
            declared, self._declared = self._declared, None
            declared.undeclare()


class NetSession:
    """A session on the network of a fleet.

    Args:
        settings: how to reach the network.

    Attributes:
        name: unique, may be a part of a key.

    Raises:
        MissingExtraError: Zenoh is not installed.
        FleetError: from the constructor: an endpoint cannot be listened on, or files of TLS are wrong.
    """

    def __init__(self, settings: NetSettings) -> None:
        require_extra("the fleet", "zenoh")
        # Zenoh reads its number of threads from these, and programs like its examples a whole configuration.
        for name in [name for name in os.environ if name.startswith("ZENOH_")]:
            del os.environ[name]
        import zenoh

        self.name = secrets.token_hex(6)
        self._zenoh = zenoh
        self._kept: list[Any] = []
        try:
            config = zenoh.Config.from_json5(json.dumps(configuration(settings)))
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            where = ", ".join((*settings.listen, *settings.connect))
            raise FleetError(f"{where}: {str(error).partition(' at ')[0]}") from None

    def close(self) -> None:
        """End the session: its tokens are gone."""
        self._session.close()  # type: ignore[no-untyped-call]  # zenoh's stubs give it no type

    @property
    def identifier(self) -> str:
        """By which Zenoh itself identifies the session (ZID)."""
        return str(self._session.zid())

    def peers(self) -> int:
        """Number of sessions this one is linked with."""
        info = self._session.info
        return len(info.peers_zid()) + len(info.routers_zid())

    def put(self, key: str, payload: bytes, urgent: bool = False, attachment: bytes | None = None) -> None:
        """Publish; dropped when a receiver does not read.

        Args:
            key: to publish at.
            payload: bytes of the message.
            urgent: before messages that are not.
            attachment: further bytes beside the payload, None without.
        """
        self._session.put(
            key,
            payload,
            congestion_control=self._zenoh.CongestionControl.DROP,
            priority=self._zenoh.Priority.DATA_HIGH if urgent else self._zenoh.Priority.DATA,
            express=True,
            attachment=attachment,
        )

    def token(self, key: str) -> Declared:
        """Make a key exist while this session lives."""
        return Declared(self._session.liveliness().declare_token(key))

    def watch_tokens(self, key: str, changed: Callable[[str, bool], object]) -> None:
        """Report tokens that exist, appear (True) and disappear (False)."""

        def report(sample: zenoh.Sample) -> None:
            changed(str(sample.key_expr), sample.kind == self._zenoh.SampleKind.PUT)

        self._kept.append(self._session.liveliness().declare_subscriber(key, report, history=True))

    def tokens(self, key: str, timeout_s: float) -> list[str]:
        """Keys of the tokens that exist now."""
        replies = self._session.liveliness().get(key, timeout=timeout_s)
        return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]

    def survey(
        self, key: str, timeout_s: float, found: Callable[[str], object], done: Callable[[], object]
    ) -> None:
        """Look for tokens: ``found`` gets each key; ``done`` is called when all sessions have answered."""
        import zenoh

        def report(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                found(str(reply.ok.key_expr))

        self._session.liveliness().get(key, zenoh.handlers.Callback(report, done), timeout=timeout_s)

    def subscribe(self, key: str, received: Callable[[str, bytes], object]) -> Declared:
        """Receive what is published: ``received`` gets the key and the bytes."""

        def report(sample: zenoh.Sample) -> None:
            received(str(sample.key_expr), sample.payload.to_bytes())

        declared = Declared(self._session.declare_subscriber(key, report))
        self._kept.append(declared)
        return declared

    def serve(self, key: str, asked: Callable[[Question], object]) -> None:
        """Receive requests at a key; each is answered by `Question.answer`."""

        def report(query: zenoh.Query) -> None:
            payload = b"" if query.payload is None else query.payload.to_bytes()
            asked(Question(str(query.key_expr), payload, query))

        self._kept.append(self._session.declare_queryable(key, report))

    def ask(
        self,
        key: str,
        payload: bytes,
        timeout_s: float,
        answered: Callable[[str, bytes], object],
        done: Callable[[], object] = lambda: None,
        urgent: bool = False,
        wait: bool = False,
    ) -> None:
        """Send a request to all sessions that serve the key.

        Args:
            key: to ask at.
            payload: bytes of the request.
            timeout_s: after which no further answer is taken.
            answered: gets the key and the bytes of every answer.
            done: called after the last answer, or when the time is over.
            urgent: before requests that are not.
            wait: wait for a full queue, `contid_fleet.net_settings.CLOSE_AFTER_S` at most; otherwise the
                request is dropped then.
        """
        import zenoh

        def report(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                answered(str(reply.ok.key_expr), reply.ok.payload.to_bytes())

        self._session.get(
            key,
            zenoh.handlers.Callback(report, done),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=timeout_s,
            congestion_control=zenoh.CongestionControl.BLOCK if wait else zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME if urgent else zenoh.Priority.INTERACTIVE_HIGH,
            express=True,
            payload=payload,
        )
