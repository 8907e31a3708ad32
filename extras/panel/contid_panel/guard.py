"""The outer layer of the panel: refuses foreign hosts and origins, and adds the security headers.

The static files hold nothing secret and need no token; a page of another site cannot read or embed them.
"""

from __future__ import annotations

from typing import Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from contid_panel.access import Access, AccessError, bearer, subprotocol_token

#: The page runs its own scripts and styles only, talks to its own server only, and is in no frame.
POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS: Final = {
    "Content-Security-Policy": POLICY,
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=(), serial=(), usb=()",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


class Guard:
    """ASGI middleware: host and origin of every request, the token of every one that is not a static file."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request, or refuse it before anything else reads it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return

        async def send_guarded(message: Message) -> None:
            if message["type"] in ("http.response.start", "websocket.http.response.start"):
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers[name] = value
                headers.setdefault("Cache-Control", "no-store")
            await send(message)

        try:
            self._check(scope)
        except AccessError as error:
            # A handshake of a WebSocket gets the same response instead of an upgrade.
            refusal = PlainTextResponse(f"{error}\n", status_code=error.status)
            await refusal(scope, receive, send_guarded)
        else:
            await self._app(scope, receive, send_guarded)

    def _check(self, scope: Scope) -> None:
        headers = dict(Headers(scope=scope).items())
        self._access.check_host(headers)
        if scope["type"] == "websocket":
            self._access.check_origin(headers, required=True)
            self._access.check_token(subprotocol_token(headers))
        elif scope["path"].startswith("/api/"):
            self._access.check_origin(headers, required=scope["method"] != "GET")
            self._access.check_token(bearer(headers))
