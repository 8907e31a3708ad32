"""Who may use the panel: names of the host, origin and token of a request. Pure checks without I/O.

A browser sends requests of every page that it shows, also of hostile ones. Three checks refuse them: the
``Host`` is a name of this panel (DNS rebinding has another one), the ``Origin`` is the panel's own (requests
of other sites), and the token of the URL is there (other users of the machine). The token is in the fragment
of the URL: browsers keep it out of requests, referrers and logs.
"""

from __future__ import annotations

import ipaddress
import re
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Final

#: Names of this machine that cannot be bound to another address by a name server.
LOOPBACK_NAMES: Final = frozenset({"127.0.0.1", "localhost", "[::1]"})
#: Random bytes of a token: it cannot be guessed.
TOKEN_BYTES: Final = 24
#: The WebSocket's subprotocol, and the prefix of the one that carries the token.
SUBPROTOCOL: Final = "contid.panel"
TOKEN_PREFIX: Final = "contid.token."
_HOST: Final = re.compile(r"(\[[0-9a-fA-F:]+\]|[A-Za-z0-9._-]+)(?::(\d{1,5}))?", re.ASCII)


class AccessError(Exception):
    """A request is refused.

    Attributes:
        status: of the response: 401 without the token, 403 for another host or origin.
    """

    def __init__(self, status: int, message: str) -> None:
        self.status = status
        super().__init__(message)


def is_loopback(host: str) -> bool:
    """True for an address that only this machine reaches."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True, slots=True)
class Access:
    """The rules of one panel.

    Attributes:
        names: hosts by which the panel may be addressed, in lower case.
        secure: served over TLS.
        token: of the URL.
    """

    names: frozenset[str] = LOOPBACK_NAMES
    secure: bool = False
    token: str = field(default_factory=partial(secrets.token_urlsafe, TOKEN_BYTES), repr=False)

    def check_host(self, headers: Mapping[str, str]) -> None:
        """Refuse another ``Host``. Any port: an SSH tunnel may have another one at its near end.

        Raises:
            AccessError: it is not a name of this panel.
        """
        found = _HOST.fullmatch(headers.get("host", ""))
        if found is None or found[1].lower() not in self.names:
            raise AccessError(403, "the Host of the request is not a name of this panel; --name adds one")

    def check_origin(self, headers: Mapping[str, str], required: bool) -> None:
        """Refuse a request that a page of another origin made.

        Args:
            headers: of the request, names in lower case.
            required: browsers always send ``Origin`` with this request.

        Raises:
            AccessError: another origin, or none where one is required.
        """
        origin = headers.get("origin")
        scheme = "https" if self.secure else "http"
        if origin is None:
            allowed = not required
        else:
            allowed = origin.lower() == f"{scheme}://{headers.get('host', '').lower()}"
        if not allowed or headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none"):
            raise AccessError(403, "the Origin of the request is not this panel")

    def check_token(self, given: str | None) -> None:
        """Refuse another token, in a time that does not depend on it.

        Raises:
            AccessError: it is missing or wrong.
        """
        if given is None or not secrets.compare_digest(given.encode(), self.token.encode()):
            raise AccessError(401, "the token is missing or wrong; open the URL that `contid panel` printed")


def bearer(headers: Mapping[str, str]) -> str | None:
    """The token of an ``Authorization`` header."""
    kind, _, token = headers.get("authorization", "").partition(" ")
    return token if kind.lower() == "bearer" else None


def subprotocol_token(headers: Mapping[str, str]) -> str | None:
    """The token among the subprotocols of a WebSocket; a browser can send no other header with it."""
    offered = (name.strip() for name in headers.get("sec-websocket-protocol", "").split(","))
    return next((name.removeprefix(TOKEN_PREFIX) for name in offered if name.startswith(TOKEN_PREFIX)), None)
