"""The panel's process: one uvicorn server, below the processes that move robots, above their clients."""

from __future__ import annotations

import asyncio
import socket
import ssl
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import uvicorn

from contid.control.daemon.responsive import responsive
from contid.errors import ContidError
from contid_panel.access import LOOPBACK_NAMES, Access, is_loopback
from contid_panel.app import PanelApp
from contid_panel.limits import MAX_HEADER, MAX_MESSAGE, panel_http
from contid_panel.priority import before_clients

#: Nice value where it is permitted, when `contid_panel.priority` is not: at 5 a STOP waited for clients
#: that flood the daemon, up to 100 ms. The daemon is at -10, the control process in real time.
NICE: Final = -5
#: Tried first, so that a bookmark of the tunnel stays right; another free port when it is taken.
DEFAULT_PORT: Final = 8421
#: Seconds between pings of the WebSocket: a page whose network is gone is closed.
PING_PERIOD_S: Final = 5.0
_EVERY_ADDRESS: Final = frozenset(("", "0.0.0.0", "::"))


class PanelError(ContidError):
    """The panel cannot be served like that."""


@dataclass(frozen=True, slots=True)
class PanelSettings:
    """How a panel is served.

    Attributes:
        socket: of the daemon.
        host: address to listen on.
        port: 0 for any, None for `DEFAULT_PORT` or any.
        read_only: pages show and stop, and give no other order.
        allow_remote: ``host`` may be reached by other machines.
        certificate: file of the TLS certificate, with its chain.
        key: file of its private key.
        names: further names by which browsers address the panel.
        demonstrates: the daemon's own input is a demonstration, which pages may take over without a question.
    """

    socket: Path
    host: str = "127.0.0.1"
    port: int | None = None
    read_only: bool = False
    allow_remote: bool = False
    certificate: Path | None = None
    key: Path | None = None
    names: tuple[str, ...] = ()
    demonstrates: bool = False

    def check(self) -> None:
        """Refuse what would let other machines in unprotected.

        Raises:
            PanelError: an address beyond loopback without ``allow_remote`` and TLS, half of a TLS pair, or
                every address without a name.
        """
        if (self.certificate is None) != (self.key is None):
            raise PanelError("--tls-certificate and --tls-key are given together")
        if is_loopback(self.host):
            return
        if not self.allow_remote or self.certificate is None:
            raise PanelError(
                f"--host {self.host} is reachable from other machines: that needs --allow-remote, "
                "--tls-certificate and --tls-key; a tunnel needs none of them: "
                "ssh -L 8421:127.0.0.1:8421 THIS-MACHINE"
            )
        if self.host in _EVERY_ADDRESS and not self.names:
            raise PanelError(
                f"--host {self.host or '(empty)'} listens on every address and is no name for a browser: add "
                "--name with the name or address of this machine, which the certificate has"
            )


def serve(settings: PanelSettings, on_ready: Callable[[str], None]) -> None:
    """Serve until SIGINT or SIGTERM.

    Args:
        settings: how.
        on_ready: called with the URL, token included, when browsers can connect.

    Raises:
        PanelError: the settings are refused, or the port is taken.
    """
    settings.check()
    listener = _listen(settings)
    port = int(listener.getsockname()[1])
    access = Access(_names(settings), secure=settings.certificate is not None)
    app = PanelApp(settings.socket, access, settings.read_only, settings.demonstrates)
    config = uvicorn.Config(
        app.asgi,
        http=panel_http(access),
        ws="websockets-sansio",
        ws_max_size=MAX_MESSAGE,
        ws_per_message_deflate=False,
        ws_ping_interval=PING_PERIOD_S,
        ws_ping_timeout=PING_PERIOD_S,
        h11_max_incomplete_event_size=MAX_HEADER,
        timeout_keep_alive=5,
        timeout_graceful_shutdown=2,
        ssl_certfile=settings.certificate,
        ssl_keyfile=None if settings.key is None else str(settings.key),
        proxy_headers=False,
        server_header=False,
        access_log=False,
        log_config=None,
        lifespan="on",
    )
    try:
        config.load()
    except (OSError, ssl.SSLError) as error:
        listener.close()
        raise PanelError(f"TLS: {error}") from None
    scheme = "https" if access.secure else "http"
    name = settings.names[0] if settings.names else settings.host
    name = f"[{name}]" if ":" in name else name
    url = f"{scheme}://{name}:{port}/#{access.token}"
    with responsive(NICE, with_group=False):
        asyncio.run(_serve(uvicorn.Server(config), listener, lambda: on_ready(url)))


async def _serve(server: uvicorn.Server, listener: socket.socket, on_ready: Callable[[], None]) -> None:
    with before_clients(asyncio.get_running_loop()):
        serving = asyncio.create_task(server.serve(sockets=[listener]))
        while not server.started and not serving.done():
            await asyncio.sleep(0.01)
        if not serving.done():
            on_ready()
        await serving


def _names(settings: PanelSettings) -> frozenset[str]:
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    return LOOPBACK_NAMES | {host.lower()} | {name.lower() for name in settings.names}


def _listen(settings: PanelSettings) -> socket.socket:
    """The listening socket.

    Raises:
        PanelError: the address cannot be used.
    """
    if settings.port is None:
        with suppress(PanelError):
            return _bound(settings.host, DEFAULT_PORT)
    return _bound(settings.host, settings.port or 0)


def _bound(host: str, port: int) -> socket.socket:
    listener = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
    try:
        # An old connection in TIME_WAIT does not block the port; a listener still does.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(128)
        listener.setblocking(False)
    except OSError as error:
        listener.close()
        raise PanelError(f"{host}:{port}: {error.strerror or error}") from None
    return listener
