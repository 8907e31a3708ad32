"""A session of Zenoh, closed by default: explicit endpoints, no discovery, nothing from the environment.

The only module that imports zenoh. Its callbacks run in threads of Zenoh.
"""

from __future__ import annotations

import asyncio
import json
import os
import secrets
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal

from contid.errors import ContidError, require_extra
from contid_fleet.endpoints import PROTOCOLS, protocol

if TYPE_CHECKING:
    import zenoh

    from contid_fleet.fleet_file import Tls

#: Silence of a link after which its tokens are gone and its sessions closed.
LINK_LEASE_S: Final = 1.0
KEEP_ALIVES_PER_LEASE: Final = 4
#: Pause between two attempts to connect.
RETRY_S: Final = (0.1, 0.5)
#: Longest wait of a sender for a full queue. A put with DROP waits the first time, one with BLOCK the second.
DROP_AFTER_S: Final = 0.001
CLOSE_AFTER_S: Final = 0.2
#: Bytes of one message.
MAX_MESSAGE: Final = 1 << 20


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
class NetSettings:
    """How to reach the network.

    Attributes:
        listen, connect: endpoints, checked by `contid_fleet.endpoints`.
        tls: files of TLS, None without.
        connect_timeout_s: longest wait of the constructor for endpoints that do not answer; it goes on later.
        access: the access rules of Zenoh (`access_control`), None without.
        mode: ``client`` has links to a router only, and ``router`` passes messages on between its links. The
            constructor of a client waits for the router.
    """

    listen: Sequence[str] = ()
    connect: Sequence[str] = ()
    tls: Tls | None = None
    connect_timeout_s: float = 0.0
    access: Mapping[str, Any] | None = None
    mode: Literal["peer", "client", "router"] = "peer"


def configuration(settings: NetSettings) -> dict[str, Any]:
    """The configuration of Zenoh; everything that opens a way in by itself is off."""
    used = {protocol(each) for each in (*settings.listen, *settings.connect)}
    link: dict[str, Any] = {
        "protocols": sorted(used) or list(PROTOCOLS[:1]),
        "tx": {
            "lease": round(LINK_LEASE_S * 1e3),
            "keep_alive": KEEP_ALIVES_PER_LEASE,
            "queue": {
                "congestion_control": {
                    "drop": {"wait_before_drop": round(DROP_AFTER_S * 1e6)},
                    "block": {"wait_before_close": round(CLOSE_AFTER_S * 1e6)},
                }
            },
        },
        "rx": {"max_message_size": MAX_MESSAGE},
    }
    if (tls := settings.tls) is not None:
        link["tls"] = {
            "root_ca_certificate": str(tls.ca),
            "listen_certificate": str(tls.certificate),
            "listen_private_key": str(tls.key),
            "connect_certificate": str(tls.certificate),
            "connect_private_key": str(tls.key),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        }
    retry = {
        "period_init_ms": round(RETRY_S[0] * 1e3),
        "period_max_ms": round(RETRY_S[1] * 1e3),
        "period_increase_factor": 2,
    }
    whole: dict[str, Any] = {
        "mode": settings.mode,
        "listen": {"endpoints": list(settings.listen), "exit_on_failure": True},
        "connect": {
            "endpoints": list(settings.connect),
            # Zenoh keeps trying after this time; 0 would mean one attempt only.
            "timeout_ms": round(settings.connect_timeout_s * 1e3) if settings.connect_timeout_s else -1,
            "exit_on_failure": False,
            "retry": retry,
        },
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "adminspace": {"enabled": False},
        "plugins_loading": {"enabled": False},
        "transport": {"link": link, "shared_memory": {"enabled": False}},
    }
    if settings.access is not None:
        whole["access_control"] = settings.access
    return whole


@dataclass(frozen=True, slots=True)
class Question:
    """A request that came by network; it is answered once, from any thread."""

    key: str
    payload: bytes
    _query: zenoh.Query = field(repr=False)

    def answer(self, key: str, payload: bytes) -> None:
        """Send the response; one that cannot be sent any more is dropped."""
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

    Attributes:
        name: unique, a chunk of a key.

    Raises:
        MissingExtraError: Zenoh is not installed.
        FleetError: from the constructor: an endpoint cannot be listened on, or files of TLS are wrong.
    """

    def __init__(self, settings: NetSettings) -> None:
        require_extra("the fleet", "zenoh")
        # Zenoh reads its threads, and programs by its example a whole configuration, from these.
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
        """Publish; dropped when a receiver does not read."""
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
        """Look for tokens; ``done`` is called when every linked session has answered."""
        import zenoh

        def report(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                found(str(reply.ok.key_expr))

        self._session.liveliness().get(key, zenoh.handlers.Callback(report, done), timeout=timeout_s)

    def subscribe(self, key: str, received: Callable[[str, bytes], object]) -> Declared:
        """Receive what is published."""

        def report(sample: zenoh.Sample) -> None:
            received(str(sample.key_expr), sample.payload.to_bytes())

        declared = Declared(self._session.declare_subscriber(key, report))
        self._kept.append(declared)
        return declared

    def serve(self, key: str, asked: Callable[[Question], object]) -> None:
        """Receive requests; each is answered by `Question.answer`."""

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
        """Send a request to all whom the key concerns; ``done`` is called after the last answer.

        With ``wait`` it waits for a full queue, `CLOSE_AFTER_S` at most; otherwise it is dropped then.
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
