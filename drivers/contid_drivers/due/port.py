"""The serial port of a Due: requests and answers as frames."""

from __future__ import annotations

import os
import select
import time
from typing import Final

from contid_drivers.due.frames import FrameReader, seal
from contid_drivers.locked_port import PORT_ERRORS, LockedPort

#: Exact on both chips of the programming port; the native port ignores it.
BAUD: Final = 250_000


class DuePort(LockedPort):
    """Frames over a serial device."""

    def __init__(self, device: str, path: str) -> None:
        super().__init__(device, path, BAUD)
        self._reader = FrameReader()

    def ask(self, payload: bytes, deadline: float) -> bytes | None:
        """Send a request; return the payload of its answer, None after the deadline.

        Args:
            payload: the request; its third byte is the sequence number.
            deadline: on `time.monotonic`.

        Raises:
            DeviceLostError: the device is gone.
        """
        self._write(seal(payload), deadline)
        while data := self.receive(deadline):
            answers = [one for one in self._reader.feed(data) if one[2:3] == payload[2:3]]
            if answers:
                return answers[-1]
        return None

    def _write(self, data: bytes, deadline: float) -> None:
        try:
            while data:
                _, ready, _ = select.select([], [self.fd], [], max(0.0, deadline - time.monotonic()))
                if not ready:
                    return  # the buffer stays full; the caller's time-out follows
                data = data[os.write(self.fd, data) :]
        except PORT_ERRORS as error:
            raise self.lost(error) from error
