"""A robot of a race whose model answers when a test lets it, as one in a process of its own."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any

from contid.control.engine.messages import Goto, Message, Rows
from contid.control.process.isolation.model_threads import check_awaited
from contid.remote.server.request_handler import RequestHandler
from tests.remote.orders.races import Race


class GatedModel:
    """A model that searches and computes tips only while its gate is open.

    Attributes:
        gate: open or not.
        asked: questions that have come.
        on_loop: questions that came in the thread of the event loop, which waits for none.
    """

    def __init__(self, model: Any) -> None:
        self.gate = threading.Event()
        self.gate.set()
        self.asked = self.on_loop = 0
        self._model = model

    def __getattr__(self, name: str) -> Any:
        return getattr(self._model, name)

    def inverse(self, *arguments: Any) -> Any:
        self._answer()
        return self._model.inverse(*arguments)

    def forward(self, *arguments: Any) -> Any:
        self._answer()
        return self._model.forward(*arguments)

    def _answer(self) -> None:
        check_awaited()
        self.asked += 1
        self.on_loop += threading.current_thread() is threading.main_thread()
        assert self.gate.wait(20.0), "never opened"


@contextmanager
def isolated(handler: RequestHandler, robot: str) -> Iterator[GatedModel]:
    """Have a robot's model asked as one of another package is."""
    config = handler.view.configs[robot]
    gated = GatedModel(config.model)
    handler.view.configs[robot] = replace(config, model=gated)
    checks = handler.moves._checks
    with ExitStack() as stack:
        for threads in (
            checks._short, checks._long, handler.view.answers._threads, handler.trackers._threads
        ):  # fmt: skip
            threads._threads[robot] = stack.enter_context(ThreadPoolExecutor(1))
        try:
            yield gated
        finally:
            gated.gate.set()


class SentMoves:
    """The robots that targets were sent to, in the order in which they were sent."""

    def __init__(self, race: Race) -> None:
        self.robots: list[str] = []
        self._send = race.run.send
        race.run.send = self.send  # type: ignore[method-assign]

    def send(self, message: Message) -> None:
        if isinstance(message, Goto):
            self.robots.append(message.robot)
        if isinstance(message, Rows):
            self.robots += [name for name, target in message.targets.items() if target is not None]
        self._send(message)
