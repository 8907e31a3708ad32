"""How a session of Zenoh is configured: closed by default, with explicit endpoints and no discovery."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

from contid_fleet.endpoints import PROTOCOLS, protocol

if TYPE_CHECKING:
    from contid_fleet.fleet_file import Tls

#: Silence of a link after which its tokens are gone and its sessions closed; within it, a session that has
#: nothing to send sends this many signs of life.
LINK_LEASE_S: Final = 1.0
KEEP_ALIVES_PER_LEASE: Final = 4
#: First and longest pause between two attempts to connect.
RETRY_S: Final = (0.1, 0.5)
#: Longest wait of a sender for a full queue. A put with DROP waits the first time, one with BLOCK the second.
DROP_AFTER_S: Final = 0.001
CLOSE_AFTER_S: Final = 0.2
#: Most bytes of one message.
MAX_MESSAGE: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class NetSettings:
    """How to reach the network.

    Attributes:
        listen, connect: endpoints, checked by `contid_fleet.endpoints`.
        tls: files of TLS, None without.
        connect_timeout_s: longest wait of the constructor for endpoints that do not answer, 0 for none; it
            tries again later.
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
