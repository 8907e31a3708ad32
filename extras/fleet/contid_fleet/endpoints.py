"""Endpoints of a fleet, ``PROTOCOL/ADDRESS``: TLS, or what stays on this machine.

``tls/192.168.1.10:7447``; without TLS only ``tcp/127.0.0.1:7447`` and ``unixsock-stream//run/fleet/s``.
"""

from __future__ import annotations

import ipaddress
import re
from typing import Final

PROTOCOLS: Final = ("tls", "tcp", "unixsock-stream")
_PORT: Final = re.compile(r"[0-9]{1,5}")
_HOST_NAME: Final = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?")


def protocol(endpoint: str) -> str:
    """The protocol of an endpoint."""
    return endpoint.partition("/")[0]


def is_host_name(text: str) -> bool:
    """True for a name of a machine."""
    return _HOST_NAME.fullmatch(text) is not None


def check_endpoint(endpoint: str, listening: bool) -> str:
    """The endpoint; refuses one that is reachable from other machines without TLS, or at every address.

    Raises:
        ValueError: with the reason.
    """
    name, _, address = endpoint.partition("/")
    if name not in PROTOCOLS:
        raise ValueError(
            f"{endpoint!r}: one of {', '.join(PROTOCOLS)} is expected, as in tls/192.168.1.10:7447"
        )
    if any(character in address for character in "?#;"):
        raise ValueError(f"{endpoint!r}: options of an endpoint are not allowed")
    if name == "unixsock-stream":
        if not address.startswith("/"):
            raise ValueError(
                f"{endpoint!r}: an absolute path is expected: unixsock-stream//run/user/1000/fleet"
            )
        return endpoint
    host, colon, port = address.rpartition(":")
    if not colon or not _PORT.fullmatch(port) or not 0 < int(port) < 65536:
        raise ValueError(f"{endpoint!r}: a host and a port are expected, as in {name}/192.168.1.10:7447")
    found = ip_address(host)
    if found is None and (listening or not is_host_name(host)):
        raise ValueError(f"{endpoint!r}: an IP address is expected, as in {name}/192.168.1.10:{port}")
    if found is not None and found.is_unspecified:
        raise ValueError(f"{endpoint!r}: that is every address of the machine; give one of them")
    if name == "tcp" and not is_loopback(host):
        raise ValueError(
            f"{endpoint!r} leaves this machine without TLS; use tls/{address}, tcp/127.0.0.1:{port} "
            "or a Unix socket"
        )
    return endpoint


def is_loopback(host: str) -> bool:
    """True for an address that only this machine reaches; a name is none."""
    address = ip_address(host)
    return address is not None and address.is_loopback


def ip_address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """The address of a host, of IPv6 also in brackets; None for a name."""
    bare = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    try:
        return ipaddress.ip_address(bare)
    except ValueError:
        return None
