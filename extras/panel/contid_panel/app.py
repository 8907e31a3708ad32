"""The web application: static files, the WebSocket of the pages, and four requests.

These are ``hello`` (version, and whether the panel is read-only), ``estop``, which also a read-only panel
carries out, ``check`` of an uploaded trajectory or of a recording, and ``modes`` of a robot.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Final

from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Scope
from starlette.websockets import WebSocket

from contid import __version__
from contid.errors import ContidError
from contid.remote.protocol.wire import Fields
from contid_panel.access import Access
from contid_panel.checks import Checks
from contid_panel.geometry import modes
from contid_panel.guard import Guard
from contid_panel.hub import Hub
from contid_panel.limits import MAX_PAGES, MAX_UPLOAD, UPLOAD_TIMEOUT_S
from contid_panel.page import Page
from contid_panel.page_client import PageClient
from contid_panel.poses import PanelPoses

STATIC: Final = Path(__file__).parent / "static"


class KeptFiles(StaticFiles):
    """The files of the page under the name of their version, which browsers keep until it is another.

    A page has 36 of them: to ask for each again at every reload took a fifth of a second of this process.
    """

    def __init__(self) -> None:
        super().__init__(directory=STATIC)
        self._version = ""

    def index(self) -> str:
        """The page, with the names of the newest files."""
        read = hashlib.blake2b(digest_size=8)
        for file in sorted(path for path in STATIC.rglob("*") if path.is_file()):
            read.update(file.read_bytes())
        self._version = read.hexdigest()
        text = (STATIC / "index.html").read_text(encoding="utf-8")
        return text.replace('"/static/', f'"/files/{self._version}/')

    async def get_response(self, path: str, scope: Scope) -> Response:
        """A file; browsers keep it when the version is the newest."""
        response = await super().get_response(path, scope)
        if scope["path_params"]["version"] == self._version:
            response.headers["Cache-Control"] = "private, max-age=31536000, immutable"
        return response


class PanelApp:
    """The panel of one daemon.

    Args:
        socket: of the daemon.
        access: who may use the panel.
        read_only: pages show and stop, and give no other order.
        demonstrates: the daemon's own input is a demonstration, which pages may take over without a question.

    Attributes:
        hub: its connection for telemetry.
        asgi: the application, guarded.
    """

    def __init__(self, socket: Path, access: Access, read_only: bool, demonstrates: bool = False) -> None:
        self.hub = Hub(socket)
        self._demonstrates = demonstrates
        self._read_only = read_only
        self._checks = Checks(self.hub)
        self._poses = PanelPoses(self.hub)
        self._stopper = PageClient(socket, "panel stop")
        self._pages = 0
        self._uploading = asyncio.Lock()
        self._files = KeptFiles()
        routes = [
            Route("/", self._index),
            Route("/api/hello", self._hello, methods=["GET"]),
            Route("/api/estop", self._estop, methods=["POST"]),
            Route("/api/modes", self._serve_modes, methods=["GET"]),
            Route("/api/check", self._serve_check, methods=["POST"]),
            WebSocketRoute("/socket", self._socket),
            Mount("/files/{version}", self._files),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
        self.asgi: ASGIApp = Guard(Starlette(routes=routes, lifespan=self._lifespan), access)

    @contextlib.asynccontextmanager
    async def _lifespan(self, app: Starlette) -> AsyncIterator[None]:
        reading = [asyncio.create_task(each) for each in (self.hub.run(), self._poses.watch())]
        try:
            yield
        finally:
            for task in reading:
                task.cancel()
            await asyncio.gather(*reading, return_exceptions=True)
            await self._stopper.abandon()

    async def _index(self, request: Request) -> Response:
        return HTMLResponse(self._files.index())

    async def _hello(self, request: Request) -> Response:
        return JSONResponse({"version": __version__, "read_only": self._read_only})

    async def _estop(self, request: Request) -> Response:
        """Stop all robots for a page whose WebSocket is lost, read-only or not; the body does not matter."""
        try:
            return JSONResponse(await self._stopper.stop(lambda client: client.estop()))
        except (ContidError, OSError) as error:
            return PlainTextResponse(f"{error}\n", status_code=503)

    async def _serve_modes(self, request: Request) -> Response:
        """How a robot swings where it is commanded to."""
        name, geometry = request.query_params.get("robot", ""), self.hub.geometry
        actuation = self.hub.commands().get(name)
        if geometry is None or actuation is None:
            return PlainTextResponse("where the robot is is not known\n", status_code=404)
        try:
            # In a thread: a stop must not wait for the modes.
            return JSONResponse(await asyncio.to_thread(modes, geometry, name, actuation))
        except ContidError as error:
            return PlainTextResponse(f"{error}\n", status_code=409)

    async def _serve_check(self, request: Request) -> Response:
        """Check an uploaded trajectory, or the recording that the query names."""
        if self._read_only:
            return PlainTextResponse("this panel is read-only\n", status_code=403)
        if self._uploading.locked():  # each takes memory, and a check takes a core
            return PlainTextResponse("another trajectory is being checked\n", status_code=503)
        async with self._uploading:
            if (recording := request.query_params.get("recording")) is not None:
                return JSONResponse(await self._check_recording(recording))
            return await self._check_upload(request)

    async def _check_recording(self, name: str) -> Fields:
        """Check what was commanded in a recording of the run."""
        try:
            text = await self.hub.recorded.trajectory(name, self.hub.described or {"robots": {}})
        except ContidError as error:
            return {"ok": False, "findings": [str(error)]}
        return await self._checks.check(text, name)

    async def _check_upload(self, request: Request) -> Response:
        """Receive a trajectory, at most `MAX_UPLOAD` bytes within `UPLOAD_TIMEOUT_S`, and check it."""
        body = bytearray()
        try:
            async with asyncio.timeout(UPLOAD_TIMEOUT_S):
                async for chunk in request.stream():
                    body += chunk
                    if len(body) > MAX_UPLOAD:
                        return PlainTextResponse(f"more than {MAX_UPLOAD >> 20} MiB\n", status_code=413)
            text = body.decode("utf-8-sig")
        except ClientDisconnect:
            return PlainTextResponse("the upload was cut off\n", status_code=400)
        except TimeoutError:
            return PlainTextResponse("the file did not come in time\n", status_code=408)
        except UnicodeDecodeError:
            return PlainTextResponse("the file is not text in UTF-8\n", status_code=400)
        name = "".join(c for c in request.query_params.get("name", "trajectory")[:80] if c.isprintable())
        return JSONResponse(await self._checks.check(text, name))

    async def _socket(self, websocket: WebSocket) -> None:
        if self._pages >= MAX_PAGES:
            message = f"{MAX_PAGES} pages are open; close one\n"
            await websocket.send_denial_response(PlainTextResponse(message, status_code=503))
            return
        self._pages += 1
        try:
            await Page(self.hub, self._checks, self._poses, self._read_only, self._demonstrates).serve(
                websocket
            )
        finally:
            self._pages -= 1
