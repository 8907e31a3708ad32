"""Notifications to the service manager: ready, alive, stopping (the protocol of systemd's ``sd_notify``).

One datagram of ``NAME=VALUE`` lines to the Unix socket in ``NOTIFY_SOCKET``; a leading ``@`` is an abstract
socket; without the variable nothing is sent. ``WATCHDOG=1`` is sent only when ticks were completed since the
last one, so that the manager also restarts a daemon whose control process hangs.

Source: systemd's manual pages sd_notify(3) and sd_watchdog_enabled(3).
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import Final

#: Watchdog messages per timeout of the manager.
MESSAGES_PER_TIMEOUT: Final = 4.0


class Notifier:
    """Notifies the service manager, if there is one."""

    def __init__(self, environment: Mapping[str, str] = os.environ, pid: int | None = None) -> None:
        """Read the address and the watchdog interval.

        Args:
            environment: ``NOTIFY_SOCKET``, ``WATCHDOG_USEC`` and ``WATCHDOG_PID`` are used if present.
            pid: of this process.
        """
        self._address = environment.get("NOTIFY_SOCKET", "")
        self._interval_s = 0.0
        with suppress(ValueError):
            for_us = environment.get("WATCHDOG_PID", "") in ("", str(os.getpid() if pid is None else pid))
            timeout_s = int(environment.get("WATCHDOG_USEC", "0")) / 1e6
            self._interval_s = timeout_s / MESSAGES_PER_TIMEOUT if for_us else 0.0
        self._ready = False
        self._stopping = False
        self._sent_s = 0.0
        self._ticks = 0

    def ticked(self, ticks: int, now_s: float) -> None:
        """Report the number of completed ticks; the first one makes the service ready."""
        if not self._address or ticks <= self._ticks:
            return
        if not self._ready:
            self._ready = True
            self._send("READY=1")
        if self._interval_s > 0.0 and now_s - self._sent_s >= self._interval_s:
            self._sent_s, self._ticks = now_s, ticks
            self._send("WATCHDOG=1")

    def stopping(self) -> None:
        """The run is about to end."""
        if not self._stopping:
            self._stopping = True
            self._send("STOPPING=1")

    def _send(self, line: str) -> None:
        """Send without blocking; errors are ignored."""
        if not self._address:
            return
        address = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as end:
            end.setblocking(False)
            end.sendto(line.encode(), address)
