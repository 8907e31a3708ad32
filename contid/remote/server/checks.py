"""Checks of moves beside the event loop, for robots whose models have processes of their own.

What was true before a check need not be true after it: a stop, another client or another move may have ended
what it is for (`MoveChecks.end`). The check then raises at once; its thread does with its next question.
Orders of one client are carried out in their order (`ClientTurns`); orders to stop wait for none.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Collection, Coroutine
from contextlib import asynccontextmanager
from contextvars import ContextVar
from typing import Any, ParamSpec, TypeVar

from contid.control.process.isolation.model_threads import ModelThreads
from contid.remote.protocol.expiry import LASTING, check_still_valid, unpaused
from contid.remote.protocol.wire import Code, RemoteError
from contid.robot_file.load import LoadedFile

P = ParamSpec("P")
T = TypeVar("T")

#: The turn of the order that the present task serves.
_turn: ContextVar[asyncio.Event | None] = ContextVar("_turn", default=None)


class ClientTurns:
    """Orders of one client are checked and sent in their order."""

    def __init__(self) -> None:
        self._newest: dict[int, asyncio.Event] = {}
        self._ends = 0
        self._why = ""

    @asynccontextmanager
    async def turn(self, client: int, verb: str) -> AsyncIterator[None]:
        """Wait until the orders that a client gave before are checked and sent; the next one waits for this.

        Raises:
            RemoteError: the robots were stopped meanwhile, or the order has expired.
        """
        before, own, begun = self._newest.get(client), asyncio.Event(), self._ends
        self._newest[client] = own
        _turn.set(own)
        try:
            if before is not None:
                await before.wait()
                if self._ends != begun and verb not in LASTING:
                    raise RemoteError(Code.STOPPED, f"{self._why}, before the turn of this; nothing was sent")
                check_still_valid(verb)
            yield
        finally:
            own.set()
            if self._newest.get(client) is own:
                del self._newest[client]

    def end(self, why: str) -> None:
        """The orders that wait for their turn are not carried out: a stop that came after them is."""
        self._ends, self._why = self._ends + 1, why


def end_turn() -> None:
    """The order that the present task serves is checked; what it sends, it sends before its next await."""
    own = _turn.get()
    if own is not None:
        own.set()


class MoveChecks:
    """The checks of one daemon; those of robots with contid's own models take place at once."""

    def __init__(self, loaded: LoadedFile) -> None:
        self._short, self._long = ModelThreads(loaded), ModelThreads(loaded)
        self._running: set[asyncio.Task[Any]] = set()
        self._ends = 0
        self._why = ""

    async def short(
        self, verb: str, robots: Collection[str], check: Callable[P, T], *args: P.args, **keys: P.kwargs
    ) -> T:
        """What a check of a point or a row finds, which asks the models of robots.

        Raises:
            RemoteError: what it was for has ended, or the daemon stood still until it had expired.
        """
        if not self._short.isolated(robots):
            return check(*args, **keys)
        async with unpaused(verb) as check_pause:
            found = await self._unless_ended(self._short.call(robots, check, *args, **keys))
            check_pause()
        return found

    async def long(
        self, robots: Collection[str], check: Callable[P, T], *args: P.args, **keys: P.kwargs
    ) -> T:
        """What a check of a trajectory finds, which takes long with any model.

        Raises:
            RemoteError: what it was for has ended.
        """
        if not self._long.isolated(robots):
            return await asyncio.to_thread(check, *args, **keys)
        return await self._unless_ended(self._long.call(robots, check, *args, **keys))

    def end(self, why: str) -> None:
        """End the checks that take place: nothing is sent for them."""
        self._ends, self._why = self._ends + 1, why
        for task in self._running:
            task.cancel()

    async def _unless_ended(self, check: Coroutine[Any, Any, T]) -> T:
        begun, task = self._ends, asyncio.create_task(check)
        self._running.add(task)
        found: list[T] = []
        try:
            found.append(await task)
        except asyncio.CancelledError:
            if self._ends == begun:  # the request itself was cancelled
                raise
        finally:
            self._running.discard(task)
        if self._ends != begun:  # perhaps after the check had its answer
            raise RemoteError(Code.STOPPED, f"{self._why}, during the check of this; nothing was sent")
        return found[0]
