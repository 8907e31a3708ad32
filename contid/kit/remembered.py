"""What a host remembers of the devices of a bus: which ones they were, and where they stood.

Adapters without a serial number come back under each other's names, and a device that was off does not know
where it stands. One small file per bus in the user's state folder holds the identities that answered there
last, and the positions at the last close; a process that ends otherwise leaves them unknown. A file is
written by the owner of the port alone and replaced as a whole.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final, Protocol

from pydantic import TypeAdapter, ValidationError

from contid.errors import ContidError
from contid.whole_file import replacing

log = logging.getLogger(__name__)

#: Devices behind a pseudo terminal are emulated, and new at every start; they are not remembered.
EMULATED: Final = "/dev/pts/"


class Named(Protocol):
    """An axis."""

    @property
    def name(self) -> str:
        """``ROBOT.AXIS``."""


@dataclass(frozen=True, slots=True)
class Remembered:
    """The devices of a bus.

    Attributes:
        bus, port: of the robot file, as written.
        axes: names of its axes, sorted.
        devices: identity by address on the bus.
        boot: start of the device that ``positions_rad`` belong to; None when unknown.
        positions_rad: where the axes stood at the last close [rad], by axis; None for one that was not known.
            Empty while the bus is in use, and after a process that did not close it.
    """

    bus: str
    port: str
    axes: tuple[str, ...]
    devices: Mapping[str, str] = field(default_factory=dict)
    boot: int | None = None
    positions_rad: Mapping[str, float | None] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"bus {self.bus} at {self.port}"


_FORMAT: Final = TypeAdapter(Remembered)


def state_folder() -> Path:
    """Folder of these files: that of the service, or the user's; the system's for a user without a home."""
    if service := os.environ.get("STATE_DIRECTORY"):
        return Path(service.partition(":")[0]) / "buses"
    home = Path(os.environ.get("XDG_STATE_HOME", ""))
    if not home.is_absolute():  # such a value is to be ignored (XDG Base Directory Specification)
        try:
            home = Path("~/.local/state").expanduser()
        except RuntimeError:
            home = Path("/var/lib")
    return home / "contid" / "buses"


class BusMemory:
    """The file of one bus; a bus is known by its name, its port as written, and its axes."""

    def __init__(self, bus: str, port: str, axes: Iterable[Named]) -> None:
        self.empty = Remembered(bus, port, tuple(sorted(axis.name for axis in axes)))
        key = json.dumps([bus, port, self.empty.axes])
        self.path = state_folder() / f"{hashlib.sha256(key.encode()).hexdigest()[:16]}.json"

    def load(self) -> Remembered | None:
        """What is remembered; None when the bus was never opened; one without devices from a damaged file."""
        try:
            return _read(self.path)
        except FileNotFoundError:
            return None
        except (OSError, ValidationError) as error:
            reason = error.strerror if isinstance(error, OSError) else "damaged"
            log.warning("%s: %s; the devices of %s count as not met before", self.path, reason, self.empty)
            return self.empty

    def save(self, remembered: Remembered) -> bool:
        """Replace the file; false, and a warning, without the rights to."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with replacing(self.path, 0o600) as file:
                file.write(json.dumps(asdict(remembered), indent=1).encode())
        except (OSError, ContidError) as error:
            log.warning("the devices of %s are not remembered, so an exchange passes: %s", remembered, error)
            return False
        return True

    def others(self) -> Iterator[Remembered]:
        """Other buses of this host; neither other files of the same port, nor this bus under another port."""
        for path in sorted(self.path.parent.glob("*.json")):
            try:
                found = _read(path)
            except (OSError, ValidationError):
                continue
            same = (found.bus, found.axes) == (self.empty.bus, self.empty.axes)
            if path != self.path and found.port != self.empty.port and not same:
                yield found

    def owner_of(self, identity: str) -> str:
        """Which other bus has a device, as text; "" for none."""
        return next((str(each) for each in self.others() if identity in each.devices.values()), "")


def _read(path: Path) -> Remembered:
    return _FORMAT.validate_json(path.read_bytes())


def memory_of(bus: str, port: str, path: str, axes: Iterable[Named]) -> BusMemory | None:
    """The file of the bus whose port is found at ``path``; None for emulated devices."""
    return None if os.path.realpath(path).startswith(EMULATED) else BusMemory(bus, port, axes)


def accept_remedy(bus: str) -> str:
    """What to do about devices that are not those of a bus."""
    return (
        "give each robot its own adapter again (by-path names in `port:` differ also between equal ones); "
        f"if it was exchanged on purpose: `contid doctor FILE --accept {bus}`"
    )
