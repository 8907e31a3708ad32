"""The served page: only with its token, only under its own name, with bounded connections."""

from __future__ import annotations

import re
import socket
import threading
from collections.abc import Iterator
from http.client import HTTPConnection, HTTPResponse
from urllib.parse import urlsplit

import pytest

from contid.control.daemon.run import run
from contid.control.daemon.run_request import RunRequest
from contid_view import csp_proxy
from contid_view.csp_proxy import LOOPBACK, MAX_BODY_BYTES, MAX_CONNECTIONS, MAX_HEAD_BYTES
from contid_view.observer import ViewerObserver
from contid_view.rerun.session import WebServer
from contid_view.view_target import Kind, ViewTarget
from tests.support.waiting import until

pytestmark = pytest.mark.process

DATA = "/rerun.sdk_comms.v1alpha1.MessageProxyService/ReadMessages"
#: An empty message of gRPC-web.
EMPTY = bytes(5)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WebServer]:
    folder = tmp_path_factory.mktemp("page")
    rows, drawing = folder / "rows.csv", folder / "hand.rrd"
    rows.write_text("t_s,left.x_mm,left.y_mm,right.x_mm,right.y_mm\n0,50,70,50,70\n0.5,48,70,52,70\n")
    observers = [ViewerObserver(ViewTarget(Kind.FILE, drawing))]
    request = RunRequest("hand", trajectory=str(rows), mock=True, virtual=True, observers=observers)
    assert run(request).exit_code == 0
    server = WebServer(str(drawing))
    yield server
    server.close()


def host_of(served: WebServer) -> str:
    return urlsplit(served.url).netloc


def port_of(served: WebServer) -> int:
    return int(host_of(served).rpartition(":")[2])


def answer(
    served: WebServer, path: str, method: str = "GET", body: bytes | str | None = None, **headers: str
) -> HTTPResponse:
    """The answer to one request; ``_`` in names of headers is a dash."""
    connection = HTTPConnection(LOOPBACK, port_of(served), timeout=20)
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(method, path, body, named)
    return connection.getresponse()


def cookie_of(served: WebServer) -> str:
    parts = urlsplit(served.url)
    with answer(served, f"/?{parts.query}") as page:
        assert page.status == 200
        given = page.headers["Set-Cookie"]
        assert b"Rerun" in page.read()
    assert re.search(r"HttpOnly; SameSite=Strict$", given)
    return str(given.partition(";")[0])


def test_the_address_with_its_token_opens_page_and_data(served: WebServer) -> None:
    cookie = cookie_of(served)
    with answer(served, "/re_viewer.js", Cookie=cookie) as script:
        assert script.status == 200
        assert len(script.read()) > 10_000
        assert "connect-src 'self';" in script.headers["Content-Security-Policy"]
    kind = "application/grpc-web+proto"
    with answer(served, DATA, "POST", EMPTY, Cookie=cookie, Content_Type=kind, X_Grpc_Web="1") as data:
        assert data.status == 200
        assert data.headers["Access-Control-Allow-Origin"] is None
        assert b"hand" in data.read(200_000)  # the recording's name


@pytest.mark.parametrize("path", ["/", "/?token=", "/?token=wrong", "/re_viewer.js", DATA])
def test_without_the_token_nothing_is_answered(served: WebServer, path: str) -> None:
    port = port_of(served)
    for headers in ({}, {"Cookie": f"contid-{port}=wrong"}, {"Cookie": f"contid-{port}"}):
        with answer(served, path, "POST" if path == DATA else "GET", **headers) as refused:
            assert refused.status == 403
            assert b"open the whole address" in refused.read()


def test_another_name_and_another_site_are_refused(served: WebServer) -> None:
    """A site that leads its own name to this machine, and one whose page asks for this address."""
    cookie, host = cookie_of(served), host_of(served)
    names = ("evil.example", f"evil.example:{port_of(served)}", "localhost", LOOPBACK)
    for name in names:
        with answer(served, "/re_viewer.js", Cookie=cookie, Host=name) as refused:
            assert refused.status == 421
    for origin in ("http://evil.example", "null", f"https://{host}"):
        with answer(served, DATA, "POST", EMPTY, Cookie=cookie, Origin=origin) as refused:
            assert refused.status == 403
    with answer(served, "/re_viewer.js", Cookie=cookie, Origin=f"http://{host}") as taken:
        assert taken.status == 200


@pytest.mark.parametrize(
    ("request_text", "status"),
    [
        (f"GET / HTTP/1.1\r\nX: {'x' * 2 * MAX_HEAD_BYTES}\r\n\r\n", 431),
        ("GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n", 400),
        ("GET http://evil.example/ HTTP/1.1\r\nHost: a\r\n\r\n", 400),
        ("nonsense\r\n\r\n", 400),
        ("POST {data} HTTP/1.1\r\n{known}Transfer-Encoding: chunked\r\n\r\n", 411),
        (f"POST {{data}} HTTP/1.1\r\n{{known}}Content-Length: {MAX_BODY_BYTES + 1}\r\n\r\n", 413),
        ("POST {data} HTTP/1.1\r\n{known}Content-Length: -1\r\n\r\n", 411),
        ("DELETE / HTTP/1.1\r\n{known}\r\n", 405),
        ("POST / HTTP/1.1\r\n{known}\r\n", 405),
    ],
)
def test_what_no_browser_sends_is_refused(served: WebServer, request_text: str, status: int) -> None:
    known = f"Host: {host_of(served)}\r\nCookie: {cookie_of(served)}\r\n"
    with socket.create_connection((LOOPBACK, port_of(served)), timeout=20) as client:
        client.sendall(request_text.replace("{data}", DATA).replace("{known}", known).encode())
        assert client.recv(4096).startswith(f"HTTP/1.1 {status} ".encode())


def test_silent_connections_are_bounded_and_end(served: WebServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csp_proxy, "REQUEST_TIMEOUT_S", 1.0)
    threads = threading.active_count()
    silent = [
        socket.create_connection((LOOPBACK, port_of(served)), timeout=20) for _ in range(MAX_CONNECTIONS)
    ]
    try:
        with answer(served, "/") as refused:
            assert refused.status == 503
        assert threading.active_count() == threads
        assert [each.recv(1) for each in silent] == [b""] * MAX_CONNECTIONS  # given up after a second
        until(lambda: answer(served, "/").status == 403, "it answers again")
    finally:
        for each in silent:
            each.close()
