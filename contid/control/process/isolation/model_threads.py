"""Threads that ask isolated models in place of an event loop, which waits for no answer of a model itself."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextvars import ContextVar, copy_context
from typing import Any, ParamSpec, TypeVar

from contid.control.engine.measured_tip import MeasuredTips
from contid.control.engine.tick_layout import TickRecord
from contid.control.engine.wiring import build_robot_configs, record_layout
from contid.kinematics.isolated_robot import IsolatedRobot
from contid.robot_file.load import LoadedFile

P = ParamSpec("P")
T = TypeVar("T")

#: Set once nothing waits for the call that the present thread carries out.
_given_up: ContextVar[threading.Event | None] = ContextVar("_given_up", default=None)


class GivenUpError(BaseException):
    """Nothing waits for this call any more; no code that takes a model for wrong catches it."""


def check_awaited() -> None:
    """Raise in a call that was given up; a question of a model calls it first.

    Raises:
        GivenUpError: nothing waits for the call of this thread.
    """
    given_up = _given_up.get()
    if given_up is not None and given_up.is_set():
        raise GivenUpError


class FairLock:
    """A lock that threads get in the order in which they came: what asks on and on keeps no other waiting."""

    def __init__(self) -> None:
        self._mutex = threading.Lock()
        self._held = False
        self._waiting: deque[threading.Lock] = deque()

    def __enter__(self) -> None:
        with self._mutex:
            if not self._held:
                self._held = True
                return
            own = threading.Lock()
            own.acquire()
            self._waiting.append(own)
        own.acquire()

    def __exit__(self, *_: object) -> None:
        with self._mutex:
            if self._waiting:
                self._waiting.popleft().release()
            else:
                self._held = False


class ModelThreads:
    """A thread for every isolated model of a robot file; its calls are carried out one after another."""

    def __init__(self, loaded: LoadedFile) -> None:
        """A thread starts with its first call."""
        self._threads = {
            name: ThreadPoolExecutor(1, f"contid-model-{name}")
            for name, robot in loaded.file.robots.items()
            if isinstance(robot, IsolatedRobot)
        }

    def isolated(self, robots: Iterable[str]) -> tuple[str, ...]:
        """Those of some robots whose models are isolated."""
        return tuple(name for name in robots if name in self._threads)

    async def call(
        self, robots: Iterable[str], function: Callable[P, T], *args: P.args, **keys: P.kwargs
    ) -> T:
        """Call what asks the models of robots: in the thread of the first isolated one, else at once.

        A call whose task is cancelled ends with its next question.
        """
        asked = self.isolated(robots)
        if not asked:
            return function(*args, **keys)
        given_up, context = threading.Event(), copy_context()
        context.run(_given_up.set, given_up)
        try:
            return await asyncio.get_running_loop().run_in_executor(
                self._threads[asked[0]], lambda: context.run(function, *args, **keys)
            )
        except asyncio.CancelledError:
            given_up.set()
            raise


class MeasuredTipsBeside:
    """`MeasuredTips` of a run; a robot whose model answers slowly gets fewer samples, the others do not."""

    def __init__(self, loaded: LoadedFile, rate_hz: float, threads: ModelThreads) -> None:
        configs, layout = build_robot_configs(loaded, rate_hz), record_layout(loaded, rate_hz)
        names = [config.name for config in configs]
        isolated = threads.isolated(names)
        self._threads = threads
        self._at_once = MeasuredTips(configs, layout, [name for name in names if name not in isolated])
        self._beside = {name: MeasuredTips(configs, layout, (name,)) for name in isolated}
        self._asking: dict[str, asyncio.Task[None]] = {}

    def add(self, record: TickRecord | None) -> None:
        """Take a record; robots whose model has not answered for an earlier one leave it out."""
        self._at_once.add(record)
        for name, tips in self._beside.items():
            if name not in self._asking or self._asking[name].done():
                self._asking[name] = asyncio.create_task(self._threads.call((name,), tips.add, record))

    def complete(self, robots: dict[str, dict[str, Any]]) -> None:
        """See `MeasuredTips.complete`; models are not asked any more."""
        for task in self._asking.values():
            task.cancel()
        for tips in (self._at_once, *self._beside.values()):
            tips.complete(robots)
