"""Handlers of the signals that end a run: SIGINT, SIGTERM and, without nohup, SIGHUP."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable


class RunSignals:
    """Signal handlers in the loop of a run.

    Args:
        interrupt: for SIGINT and SIGTERM.
        hung_up: for SIGHUP.
    """

    def __init__(self, interrupt: Callable[[], None], hung_up: Callable[[], None]) -> None:
        self._handlers = {signal.SIGINT: interrupt, signal.SIGTERM: interrupt}
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # nohup
            self._handlers[signal.SIGHUP] = hung_up

    def handle(self) -> None:
        """Handle them from now on."""
        for number, handler in self._handlers.items():
            asyncio.get_running_loop().add_signal_handler(number, handler)

    def ignore(self) -> None:
        """Ignore further ones during the clean-up: raised in a task they would print a traceback."""
        for number in self._handlers:
            asyncio.get_running_loop().add_signal_handler(number, _ignore)

    def remove(self) -> None:
        """Restore the handlers of the interpreter."""
        for number in self._handlers:
            asyncio.get_running_loop().remove_signal_handler(number)


def _ignore() -> None:
    """Handler of a signal after the robots have come to rest."""
