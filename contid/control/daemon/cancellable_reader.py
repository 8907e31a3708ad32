"""Waiting for bytes in a thread that can be told to give up."""

from __future__ import annotations

import os
import select
import threading


class InputCancelledError(Exception):
    """Nobody waits for the input any more."""


class CancellableReader:
    """Lets a thread wait for a descriptor, and be told to give up."""

    def __init__(self) -> None:
        self._wake_r, self._wake_w = os.pipe()
        self._given_up = threading.Event()

    def read(self, descriptor: int, size: int) -> bytes:
        """Like `os.read`.

        Raises:
            GivenUpError: told to give up.
        """
        ready, _, _ = select.select([descriptor, self._wake_r], [], [])
        self.check()
        assert descriptor in ready
        return os.read(descriptor, size)

    def check(self) -> None:
        """Raise when told to give up; called now and then by what takes long."""
        if self._given_up.is_set():
            raise InputCancelledError

    def give_up(self) -> None:
        """From another thread: `read` and `check` raise from now on."""
        self._given_up.set()
        os.write(self._wake_w, b"!")

    def close(self) -> None:
        """Let the descriptors go; no thread waits any more."""
        os.close(self._wake_r)
        os.close(self._wake_w)
