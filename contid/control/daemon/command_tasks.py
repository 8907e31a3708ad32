"""The tasks of the sources of commands of a run; when one fails, the run ends: clients could not stop it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any


class CommandTasks:
    """Tasks beside the run.

    Args:
        failed: called with a message when a task ended with an error.
    """

    def __init__(self, failed: Callable[[str], None]) -> None:
        self._failed = failed
        self._tasks: list[asyncio.Task[None]] = []

    def start(self, source: Coroutine[Any, Any, None]) -> None:
        """Run a source of commands beside the run."""
        task = asyncio.create_task(source)
        task.add_done_callback(self._ended)
        self._tasks.append(task)

    def _ended(self, task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if error is not None:
            self._failed(f"a source of commands ended early: {type(error).__name__}: {error}")

    async def end(self) -> None:
        """Cancel all and wait for them."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
