"""The socket of a daemon and its clients in virtual time, in one process: their waits cost no time.

Server, connections, clients and engine are the product's; only the clock is not. `time.monotonic` is that of
the event loop, which moves on when nothing is left to do.
"""

from __future__ import annotations

import asyncio
import selectors
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, TypeVar

import pytest

from contid.control.engine.events import RunEvent
from contid.control.engine.tick_layout import RobotRecord, TickRecord
from contid.control.engine.virtual import VirtualProcess
from contid.control.engine.wiring import record_layout
from contid.remote.protocol.socket_path import Endpoint
from contid.remote.server.server import SocketServer
from contid.robot_file.load import load_named, with_mock
from tests.remote.orders.races import StopModel, VirtualRun

T = TypeVar("T")

#: Records that are kept for the answers of orders.
KEPT = 1000


class _VirtualSelector(selectors.DefaultSelector):
    """Waits for nothing: what a wait is to last, the clock moves on."""

    now_s = 0.0

    def select(self, timeout: float | None = None) -> Any:
        ready = super().select(0.001 if timeout is None else 0.0)
        if not ready and timeout is not None:
            self.now_s += timeout
        return ready


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop in virtual time."""

    def __init__(self) -> None:
        self._virtual = _VirtualSelector()
        super().__init__(self._virtual)

    def time(self) -> float:
        """The virtual time [s]."""
        return self._virtual.now_s


def in_virtual_time(main: Callable[[], Coroutine[Any, Any, T]]) -> T:
    """What a coroutine returns in virtual time."""
    loop = VirtualLoop()
    with pytest.MonkeyPatch.context() as patch, asyncio.Runner(loop_factory=lambda: loop) as runner:
        patch.setattr(time, "monotonic", loop.time)
        return runner.run(main())


class VirtualDaemon(VirtualRun):
    """A daemon of a robot file on simulated devices; ``judge`` gets the robots of every tick."""

    def __init__(self, name: str, judge: Callable[[list[RobotRecord]], None]) -> None:
        self.loaded = with_mock(load_named(name))
        self.rate_hz = float(self.loaded.file.rate_hz)
        self._layout = record_layout(self.loaded, self.rate_hz)
        self._inbox, self._events = [], []
        self._listeners: list[Callable[[RunEvent], None]] = []
        self._crosses_to = 0
        self._newest: TickRecord | None = None
        self.records = {}
        self.last = -1
        self._model = StopModel()
        self._judge = judge
        self._process = VirtualProcess(self.loaded, self.rate_hz, self, attended=True)
        self._process.engine.arm()

    @property
    def engine(self) -> Any:
        """Of the robots."""
        return self._process.engine

    def write(self, values: list[float]) -> None:
        super().write(values)
        self.records.pop(self.last - KEPT, None)
        assert self._newest is not None
        self._judge(list(self._newest.robots))

    def listen(self, listener: Any) -> None:
        self._listeners.append(listener)

    def _notice(self, event: RunEvent) -> None:
        for listener in self._listeners:
            listener(event)

    async def ticks(self) -> None:
        """Ticks at their rate, for ever."""
        loop = asyncio.get_running_loop()
        while True:
            self.turn(self._notice)
            await asyncio.sleep(max(self._process.tick / self.rate_hz - loop.time(), 0.0))


@asynccontextmanager
async def serving(run: VirtualDaemon) -> AsyncIterator[Path]:
    """The socket of a daemon that ticks."""
    with tempfile.TemporaryDirectory(prefix="contid-") as folder:
        path = Path(folder) / "s"
        async with asyncio.TaskGroup() as group:  # what fails in it ends the test
            parts = (SocketServer(Endpoint(path)).serve(run), run.ticks())
            tasks = [group.create_task(part) for part in parts]
            await asyncio.sleep(0)
            yield path
            for task in tasks:
                task.cancel()
