"""Blocking reads in a thread that another thread can cancel."""

from __future__ import annotations

import os
import select
import threading


class InputCancelledError(Exception):
    """The input is no longer needed."""


class CancellableReader:
    """Reads descriptors in one thread; `cancel` ends a pending read from another."""

    def __init__(self) -> None:
        self._wake_r, self._wake_w = os.pipe()
        self._cancelled = threading.Event()

    def read(self, descriptor: int, size: int) -> bytes:
        """Like `os.read`.

        Raises:
            InputCancelledError: `cancel` was called.
        """
        select.select([descriptor, self._wake_r], [], [])
        self.check()
        return os.read(descriptor, size)

    def check(self) -> None:
        """Raise `InputCancelledError` after `cancel`; long computations call it between steps."""
        if self._cancelled.is_set():
            raise InputCancelledError

    def cancel(self) -> None:
        """Make `read` and `check` raise from now on; callable from any thread."""
        self._cancelled.set()
        os.write(self._wake_w, b"!")

    def close(self) -> None:
        """Close the descriptors; no thread may be reading."""
        os.close(self._wake_r)
        os.close(self._wake_w)
