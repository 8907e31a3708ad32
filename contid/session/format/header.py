"""The head of a session as plain texts and bytes: input of the recorder's process, quick to import."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from contid.control.engine.tick_layout import RecordLayout

NPZ: Final = "application/x-npz"
#: A line from the daemon to the recorder: the recording ends here, the run does not.
END: Final = b'{"end": true}\n'


@dataclass(frozen=True, slots=True)
class Header:
    """The head of a session.

    Attributes:
        layout: layout of the records.
        device_units: ``rad`` or ``pa`` by ``ROBOT.AXIS``.
        metadata: metadata by name, each a mapping of texts; becomes metadata records.
        attachments: name, media type, content.
        wall_ns: time of day since 1970 [ns] at the instant ``monotonic_s``.
        monotonic_s: the same instant on the clock of the ticks [s].
    """

    layout: RecordLayout
    device_units: Mapping[str, str]
    metadata: Mapping[str, Mapping[str, str]]
    attachments: tuple[tuple[str, str, bytes], ...]
    wall_ns: int
    monotonic_s: float

    def time_ns(self, deadline_s: float) -> int:
        """Time of day since 1970 [ns] of an instant on the clock of the ticks."""
        return self.wall_ns + round((deadline_s - self.monotonic_s) * 1e9)


@dataclass(frozen=True, slots=True)
class Attached:
    """A trajectory that an order brought during the run; one line of JSON from the daemon to the recorder.

    Attributes:
        name: name of its attachment and its metadata.
        about: its metadata.
        path: file with its rows, for the recorder to take and remove.
    """

    name: str
    about: Mapping[str, str]
    path: str

    def line(self) -> bytes:
        """The line of JSON that goes through the pipe."""
        return json.dumps(asdict(self)).encode() + b"\n"


@dataclass(frozen=True, slots=True)
class RecorderJob:
    """What to record.

    Attributes:
        path: path of the session.
        ring: path of the ring.
        pid: process id of the ring's writer.
        header: header of the session.
        during_run: True: from the next tick on, not from the first one of the run.
    """

    path: Path
    ring: Path
    pid: int
    header: Header
    during_run: bool = False
