"""What a service manager is told: ready, alive, stopping (the protocol of systemd's ``sd_notify``).

One datagram of ``NAME=VALUE`` lines to the Unix socket that ``NOTIFY_SOCKET`` names; a name that begins with
``@`` is an abstract one. Without the variable nothing is sent. ``WATCHDOG=1`` goes out only when ticks were
completed since the last one: a daemon that lives beside a control process that does not is no sign of life
(ros_odrive 10), and the manager then restarts both.

Source: systemd's manual pages sd_notify(3) and sd_watchdog_enabled(3).
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import Final

#: The manager is told so many times within the time after which it gives up.
SIGNS_PER_LIMIT: Final = 4.0


class Notifier:
    """Tells the service manager, if there is one."""

    def __init__(self, environment: Mapping[str, str] = os.environ, pid: int | None = None) -> None:
        """Read where to send, and how often.

        Args:
            environment: with ``NOTIFY_SOCKET``, ``WATCHDOG_USEC`` and ``WATCHDOG_PID``, or without.
            pid: of this process.
        """
        self._address = environment.get("NOTIFY_SOCKET", "")
        self._interval_s = 0.0
        with suppress(ValueError):
            for_us = environment.get("WATCHDOG_PID", "") in ("", str(os.getpid() if pid is None else pid))
            limit_s = int(environment.get("WATCHDOG_USEC", "0")) / 1e6
            self._interval_s = limit_s / SIGNS_PER_LIMIT if for_us else 0.0
        self._ready = False
        self._stopping = False
        self._fed_s = 0.0
        self._ticks = 0

    def ticked(self, ticks: int, now_s: float) -> None:
        """So many ticks were completed by now; the first says that the service is ready."""
        if not self._address or ticks <= self._ticks:
            return
        if not self._ready:
            self._ready = True
            self._send("READY=1")
        if self._interval_s > 0.0 and now_s - self._fed_s >= self._interval_s:
            self._fed_s, self._ticks = now_s, ticks
            self._send("WATCHDOG=1")

    def stopping(self) -> None:
        """The run is about to end."""
        if not self._stopping:
            self._stopping = True
            self._send("STOPPING=1")

    def _send(self, line: str) -> None:
        """Never waits and never fails: a manager that does not listen is not our concern."""
        if not self._address:
            return
        address = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as end:
            end.setblocking(False)
            end.sendto(line.encode(), address)
