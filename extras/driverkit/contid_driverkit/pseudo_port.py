"""A pseudo terminal as the port of an emulated bus: can be unplugged, and has the rate that the host set."""

from __future__ import annotations

import os
import re
import termios
import tty
from contextlib import suppress
from pathlib import Path
from typing import Final

from contid.errors import DeviceNotFoundError

_RATES: Final = {code: int(name[1:]) for name, code in vars(termios).items() if re.fullmatch(r"B\d+", name)}


class PseudoPort:
    """A pty and the symbolic link to it.

    Args:
        link: its path, None for the pty's own name.

    Attributes:
        descriptor: descriptor of the end of the devices, -1 while unplugged.
    """

    def __init__(self, link: Path | str | None) -> None:
        self.descriptor = -1
        self._slave = -1
        self._link = Path(link).expanduser() if link is not None else None

    @property
    def name(self) -> str:
        """Path a host opens."""
        return str(self._link) if self._link is not None else os.ttyname(self._slave)

    @property
    def plugged(self) -> bool:
        """True while a host can open it."""
        return self.descriptor >= 0

    def plug(self, link: str | None = None) -> None:
        """Create the pty, at its link or at another one.

        Raises:
            DeviceNotFoundError: the link cannot be created.
        """
        path = self._link if link is None else Path(link).expanduser()
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        try:
            if path is not None:
                _link_to(path, os.ttyname(slave))
        except BaseException:
            os.close(master)
            os.close(slave)
            raise
        self._link, self.descriptor, self._slave = path, master, slave

    def unplug(self) -> None:
        """Remove the pty and its link; idempotent."""
        if not self.plugged:
            return
        os.close(self.descriptor)
        os.close(self._slave)
        self.descriptor = self._slave = -1
        if self._link is not None:
            self._link.unlink(missing_ok=True)

    def rate(self) -> int:
        """Baud rate set by the host; 0 for one without a name in termios."""
        return _RATES.get(termios.tcgetattr(self.descriptor)[5], 0)

    def read(self) -> bytes:
        """What the host sent."""
        try:
            return os.read(self.descriptor, 65536)
        except OSError:
            return b""

    def write(self, wire: bytes) -> None:
        """Send to the host; a full buffer without a reader loses the bytes, as a serial line would."""
        with suppress(BlockingIOError):
            os.write(self.descriptor, wire)


def _link_to(path: Path, target: str) -> None:
    if path.is_symlink():
        path.unlink()
    elif path.exists():
        raise DeviceNotFoundError(str(path), "is a real file or device", "choose another name")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.symlink_to(target)
    except OSError as error:
        why = f"cannot be created: {error.strerror or error}"
        remedy = "run it where you may write, or name another port"
        raise DeviceNotFoundError(str(path), why, remedy) from error
