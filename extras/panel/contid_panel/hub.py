"""The panel's own connection to the daemon: telemetry, events and status, for every page that is open.

It gives no orders and never holds the lease. When the daemon ends it connects again, and only shows.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from contid.client import AsyncClient
from contid.errors import ContidError
from contid.remote.client.described_robot import columns_of
from contid.remote.protocol.wire import ConnectionLostError, Fields, NoDaemonError, RemoteError
from contid.targets import Actuation
from contid_panel.expectation import Expectation
from contid_panel.expiry import clock_ms
from contid_panel.geometry import PanelGeometry
from contid_panel.mailbox import Mailbox
from contid_panel.samples import actuation_of
from contid_sessions.recorded import Recorded

log = logging.getLogger(__name__)

RATE_HZ: Final = 20.0
STATUS_PERIOD_S: Final = 0.25
RECONNECT_PERIOD_S: Final = 0.3
#: A daemon that stands still is shown as lost after this time.
RESPONSE_TIMEOUT_S: Final = 3.0
FIELDS: Final = (
    "state", "fault", "tip_mm", "command_tip_mm", "target_mm", "error_mm", "command", "measured", "limits",
    "bends", "effort", "temperature_c", "voltage_v", "measured_tip_mm",
)  # fmt: skip
_LOST: Final = (ConnectionLostError, NoDaemonError, RemoteError, OSError)


class Hub:
    """Reads from the daemon and sends to the pages.

    Attributes:
        path: of the daemon's socket.
        geometry: of its robots; None without a daemon, or when its robot file cannot be read.
        newest: fields of the newest frame of telemetry, by robot.
        described: what the daemon describes; None without a daemon.
        rates: by column, how fast it changes at full speed [1/s].
        rest: by robot, its rest pose by columns of its axes.
        expectations: by robot, its axes compared with their commands.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.geometry: PanelGeometry | None = None
        self.newest: Mapping[str, Fields] = {}
        self.described: Fields | None = None
        self.rates: Mapping[str, float] = {}
        self.rest: Mapping[str, Mapping[str, float]] = {}
        self.expectations: Mapping[str, Expectation] = {}
        self._mailboxes: set[Mailbox] = set()
        self._watched = asyncio.Event()
        self._lasting: dict[str, str] = {}
        self.recorded = Recorded()
        self._lost("not connected yet")

    # -- pages ---------------------------------------------------------------------------------------------

    def join(self, mailbox: Mailbox) -> None:
        """Send to a page from now on, first the newest message of every lasting kind."""
        for text in self._lasting.values():
            mailbox.put(text)
        self._mailboxes.add(mailbox)
        self._watched.set()

    def leave(self, mailbox: Mailbox) -> None:
        """Send no more to a page."""
        self._mailboxes.discard(mailbox)
        if not self._mailboxes:
            self._watched.clear()

    def commands(self) -> dict[str, Actuation]:
        """The newest command of every robot [m or Pa]."""
        if self.geometry is None:
            return {}
        found = {}
        for robot in self.geometry.scene.robots:
            command = self.newest.get(robot.config.name, {}).get("command")
            if command is not None and None not in command:
                found[robot.config.name] = actuation_of(robot, command)
        return found

    def present(self) -> dict[str, float]:
        """The newest commanded value of every column that is known."""
        found: dict[str, float | None] = {}
        for name, columns in columns_of(self.described or {"robots": {}}).items():
            newest = self.newest.get(name, {})
            groups = {"command": columns.axes, "command_tip_mm": columns.tip, "bends": columns.bends}
            for field, group in groups.items():
                found.update(zip(group, newest.get(field) or (), strict=False))
        return {column: value for column, value in found.items() if value is not None}

    @property
    def watched(self) -> bool:
        """A page is open."""
        return self._watched.is_set()

    def send(self, kind: str, lasting: bool = False, **fields: Any) -> None:
        """Send a message to every page; a lasting one also to those that open later."""
        text = encode_message({"kind": kind, **fields})
        if lasting:
            self._lasting[kind] = text
        for mailbox in self._mailboxes:
            mailbox.put(text)

    # -- daemon --------------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Read while pages are open; connect again when the connection ends."""
        reported = ""
        while True:
            await self._watched.wait()
            try:
                async with AsyncClient(self.path, name="panel", timeout_s=RESPONSE_TIMEOUT_S) as client:
                    await self._connected(client)
                    async with asyncio.TaskGroup() as tasks:
                        status = tasks.create_task(self._read_status(client))
                        await self._read_telemetry(client)
                        status.cancel()
            except* _LOST as errors:
                self._lost(str(errors.exceptions[0]))
            except* Exception as errors:  # such as of a model that contid does not have
                reason = repr(errors.exceptions[0])
                if reason != reported:
                    log.error("panel: it connects again after an error", exc_info=errors)
                reported = reason
                self._lost(f"an error of the panel: {reason}")
            await asyncio.sleep(RECONNECT_PERIOD_S)

    async def _connected(self, client: AsyncClient) -> None:
        describe = await client.describe()
        drawing: Fields | None = None
        problem = ""
        try:
            # In a thread: the reach of an arm takes a moment, and a stop must not wait for it.
            self.geometry = await asyncio.to_thread(PanelGeometry.of, describe)
            drawing = await asyncio.to_thread(self.geometry.describe)
        except ContidError as error:
            self.geometry, problem = None, str(error)
            log.warning("panel: the robots are not drawn: %s", problem)
        robots = {} if drawing is None else drawing["robots"]
        self.rates = {column: rate for each in robots.values() for column, rate in each["rates"].items()}
        self.rest = {name: each["rest"] for name, each in robots.items()}
        self.expectations = {} if self.geometry is None else self.geometry.expectations(describe["robots"])
        self.described = describe
        self.send("describe", lasting=True, describe=describe, drawing=drawing, problem=problem)
        self.send("daemon", lasting=True, connected=True, message="")

    def _lost(self, message: str) -> None:
        self.newest, self.described = {}, None
        text = encode_message({"kind": "daemon", "connected": False, "message": message})
        if self._lasting.get("daemon") != text:
            self.send("daemon", lasting=True, connected=False, message=message)

    async def _read_telemetry(self, client: AsyncClient) -> None:
        frames = client.telemetry(RATE_HZ, fields=FIELDS, events=True)
        async for frame in frames:
            if not self._mailboxes:
                break
            if frame["event"] == "telemetry":
                self._frame(frame)
            else:
                self.send("event", event={key: value for key, value in frame.items() if key != "event"})
        with suppress(*_LOST):
            await frames.aclose()

    def _frame(self, frame: Fields) -> None:
        self.newest = frame["robots"]
        bodies: Fields = {"robots": {}, "ghosts": {}, "ropes": []}
        if self.geometry is not None:
            bodies = self.geometry.bodies(
                {name: robot["measured"] for name, robot in self.newest.items()},
                {name: robot["command"] for name, robot in self.newest.items()},
            )
        robots = {
            name: {**robot, "expected": self.expectations[name].compared(frame["t_s"], robot)}
            if name in self.expectations
            else robot
            for name, robot in self.newest.items()
        }
        message = {"kind": "frame", "tick": frame["tick"], "t_s": frame["t_s"], "robots": robots}
        text = encode_message({**message, "bodies": bodies, "clock_ms": clock_ms()})
        for mailbox in self._mailboxes:
            mailbox.put_frame(text)

    async def _read_status(self, client: AsyncClient) -> None:
        while True:
            status = await client.status()
            self.send("status", status=status, recorded=await self.recorded.after(status))
            await asyncio.sleep(STATUS_PERIOD_S)


def encode_message(message: Mapping[str, Any]) -> str:
    """A message of the panel as JSON, floats with twelve significant digits, null for those not finite."""
    return json.dumps(_rounded(message), separators=(",", ":"), allow_nan=False)


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.12g}") if value - value == 0.0 else None
    if isinstance(value, Mapping):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return value
