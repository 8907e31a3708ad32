"""The page of the web viewer, on this machine only and with the outside locked.

Rerun's page asks Google for a font and, unless told otherwise, Rerun for statistics. This server passes the
page on with a content security policy under which a browser refuses every address but this machine's.
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
_PASSED_ON: Final = ("Content-Type", "Content-Length", "Content-Encoding", "rerun-final-length")


def policy(data_port: int) -> str:
    """What a browser may do with the page: run it, draw it, fetch the data from this machine."""
    data = " ".join(f"{scheme}://{host}:{data_port}" for scheme in ("http", "ws") for host in _HOSTS)
    return (
        "default-src 'self'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval'; "
        "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; worker-src 'self' blob:; "
        f"connect-src 'self' {data}; form-action 'none'; frame-ancestors 'none'"
    )


_HOSTS: Final = (LOOPBACK, "localhost")


class CspProxy:
    """Serves what the web server of Rerun serves, plus the policy."""

    def __init__(self, port: int, inner_port: int, data_port: int) -> None:
        """Begin to serve.

        Args:
            port: where, 0 for any.
            inner_port: of Rerun's own web server.
            data_port: of the server that has the data.
        """
        rules = policy(data_port)

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                try:
                    with urlopen(f"http://{LOOPBACK}:{inner_port}{self.path}") as answer:
                        self.send_response(answer.status)
                        for name in _PASSED_ON:
                            if (value := answer.headers.get(name)) is not None:
                                self.send_header(name, value)
                        self.send_header("Content-Security-Policy", rules)
                        self.end_headers()
                        with suppress(ConnectionError):  # the browser went away
                            shutil.copyfileobj(answer, self.wfile)
                except HTTPError as error:
                    self.send_error(error.code)
                    error.close()
                except OSError:
                    self.send_error(502)

            def log_message(self, format: str, *args: object) -> None:
                """Nobody reads them."""

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
