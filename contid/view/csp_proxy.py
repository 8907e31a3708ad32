"""The page of the web viewer, served on loopback under a content security policy.

Rerun's page loads a font from Google and reports usage statistics by default. The policy makes a browser
refuse every address but this machine's.
"""

from __future__ import annotations

import shutil
import threading
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Final
from urllib.error import HTTPError
from urllib.parse import quote
from urllib.request import urlopen

LOOPBACK: Final = "127.0.0.1"
_FORWARDED_HEADERS: Final = ("Content-Type", "Content-Length", "Content-Encoding", "rerun-final-length")


def policy(data_port: int) -> str:
    """The policy: a browser may run and draw the page, and fetch data from this machine only."""
    hosts = (LOOPBACK, "localhost")
    data = " ".join(f"{scheme}://{host}:{data_port}" for scheme in ("http", "ws") for host in hosts)
    return (
        "default-src 'self'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval'; "
        "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; worker-src 'self' blob:; "
        f"connect-src 'self' {data}; form-action 'none'; frame-ancestors 'none'"
    )


class CspProxy:
    """Forwards Rerun's web server and adds the policy."""

    def __init__(self, port: int, inner_port: int, data_port: int) -> None:
        """Serve ``inner_port``, Rerun's web server, on ``port`` (0 for any) for data from ``data_port``."""
        rules = policy(data_port)

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                try:
                    with urlopen(f"http://{LOOPBACK}:{inner_port}{self.path}") as answer:
                        self.send_response(answer.status)
                        for name in _FORWARDED_HEADERS:
                            if (value := answer.headers.get(name)) is not None:
                                self.send_header(name, value)
                        self.send_header("Content-Security-Policy", rules)
                        self.end_headers()
                        with suppress(ConnectionError):  # the browser closed the connection
                            shutil.copyfileobj(answer, self.wfile)
                except HTTPError as error:
                    self.send_error(error.code)
                    error.close()
                except OSError:
                    self.send_error(502)

            def log_message(self, format: str, *args: object) -> None:
                """Requests are not logged."""

        self._server = ThreadingHTTPServer((LOOPBACK, port), Handler)
        source = quote(f"rerun+http://{LOOPBACK}:{data_port}/proxy", safe="")
        self.url = f"http://{LOOPBACK}:{self._server.server_port}/?url={source}"
        self._thread = threading.Thread(target=self._server.serve_forever, name="contid-page", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
