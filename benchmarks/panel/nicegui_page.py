"""The STOP button and one live plot of the panel in NiceGUI, for `benchmarks.panel.frameworks`.

``python -m benchmarks.panel.nicegui_page SOCKET [--policy]``; prints its URL. ``--policy``: with the content
security policy of the panel.
"""

from __future__ import annotations

import asyncio
import os
import socket
import sys
from pathlib import Path
from typing import Any, Final

import uvicorn
from fastapi import FastAPI
from nicegui import app as lifecycle
from nicegui import ui
from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from contid.client import AsyncClient
from contid_panel.guard import POLICY
from contid_panel.server import NICE

RATE_HZ: Final = 20.0
DRAWN_HZ: Final = 10.0
WINDOW: Final = 400


class NiceguiPanel:
    """One page per browser; the elements and their handlers live here, on the server."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._client: AsyncClient | None = None
        self._samples: list[tuple[float, float, float]] = []
        self._state = "unknown"

    async def read(self) -> None:
        """Telemetry of the first robot."""
        async with AsyncClient(self._path, name="nicegui") as client:
            async for frame in client.telemetry(RATE_HZ, fields=("state", "command", "measured")):
                robot = next(iter(frame["robots"].values()))
                self._state = str(robot["state"])
                self._samples = [
                    *self._samples[-WINDOW:],
                    (frame["t_s"], robot["command"][0], robot["measured"][0]),
                ]

    async def stop(self) -> None:
        """The handler of the button."""
        if self._client is None:
            self._client = await AsyncClient(self._path, name="nicegui stop").connect()
        await self._client.estop()

    def build(self) -> None:
        """The page."""
        # pointerdown, as the panel has it: a click is complete only when the button comes up again.
        ui.button("STOP", color="red").props("data-stop").on("pointerdown", self.stop)
        state = ui.label("unknown").props("data-state")
        series = [{"type": "line", "showSymbol": False, "data": []} for _ in range(2)]
        axes: dict[str, Any] = {
            "xAxis": {"type": "value", "scale": True},
            "yAxis": {"type": "value", "scale": True},
        }
        plot = ui.echart({**axes, "animation": False, "series": series})

        def draw() -> None:
            state.set_text(self._state)
            for number in (0, 1):
                plot.options["series"][number]["data"] = [[row[0], row[1 + number]] for row in self._samples]
            plot.update()

        ui.timer(1.0 / DRAWN_HZ, draw)


def with_policy(app: ASGIApp) -> ASGIApp:
    """An application whose pages have the content security policy of the panel."""

    async def served(scope: Scope, receive: Receive, send: Send) -> None:
        async def send_with_policy(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message)["Content-Security-Policy"] = POLICY
            await send(message)

        await app(scope, receive, send_with_policy)

    return served


def main() -> None:
    """Serve until SIGTERM."""
    os.setpriority(os.PRIO_PROCESS, 0, NICE)
    panel = NiceguiPanel(Path(sys.argv[1]))
    api = FastAPI()
    ui.run_with(api, root=panel.build, show_welcome_message=False)
    lifecycle.on_startup(lambda: asyncio.create_task(panel.read()))
    listener = socket.socket()
    listener.bind(("127.0.0.1", 0))
    print(f"http://127.0.0.1:{listener.getsockname()[1]}/", flush=True)
    served = with_policy(api) if "--policy" in sys.argv else api
    config = uvicorn.Config(served, log_level="warning", ws="websockets-sansio", lifespan="on")
    asyncio.run(uvicorn.Server(config).serve(sockets=[listener]))


if __name__ == "__main__":
    main()
