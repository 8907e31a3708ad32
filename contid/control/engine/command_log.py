"""Every command of a run as CSV with exact floats, so that two runs can be compared byte for byte.

Columns: ``tick,source_s`` and per robot ``NAME.mode``, per axis ``NAME.AXIS.command`` [m or Pa] and
``NAME.AXIS.device`` [rad or Pa]; empty where nothing was commanded. Numbers are written with the fewest
digits that read back to the same float64.
"""

from __future__ import annotations

import math
import os
import stat
from pathlib import Path

from contid.control.engine.events import RunEvent
from contid.control.engine.tick_layout import RecordLayout, TickRecord
from contid.control.tick.supervisor import Mode
from contid.errors import ContidError


class CommandLog:
    """Writes records as lines; also a sink of the engine."""

    def __init__(self, path: Path, layout: RecordLayout) -> None:
        """Create the file.

        Raises:
            ContidError: it exists, or cannot be created.
        """
        self._layout = layout
        self._file = os.fdopen(_created(path), "w", encoding="ascii", newline="\n", buffering=1)
        columns = ["tick", "source_s"]
        for robot in layout.robots:
            columns.append(f"{robot.name}.mode")
            for axis in robot.axes:
                columns += [f"{robot.name}.{axis}.command", f"{robot.name}.{axis}.device"]
        self._file.write(",".join(columns) + "\n")

    def add(self, record: TickRecord) -> None:
        """One line for one tick."""
        cells = [str(record.tick), _exact(record.source_s)]
        for robot in record.robots:
            cells.append(Mode(robot.mode).name)
            for axis in robot.axes:
                cells += [_exact(axis.command), _exact(axis.device)]
        self._file.write(",".join(cells) + "\n")

    def write(self, values: list[float]) -> None:
        """See `contid.control.engine.cycle.Sink`."""
        self.add(self._layout.decode(tuple(values)))

    def event(self, event: RunEvent) -> None:
        """Events are not commands."""

    def close(self) -> None:
        """Finish the file."""
        self._file.close()


def _exact(value: float) -> str:
    return "" if math.isnan(value) else repr(value)


def _created(path: Path) -> int:
    """The descriptor of a new file that only its owner may read, or of a device or pipe.

    Raises:
        ContidError: a file or a link of this name exists, or it cannot be created.
    """
    flags = os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC
    try:
        try:
            return os.open(path, flags | os.O_CREAT | os.O_EXCL, 0o600)
        except FileExistsError:
            kind = path.lstat().st_mode
            if not stat.S_ISCHR(kind) and not stat.S_ISFIFO(kind):
                raise ContidError(f"{path}: file exists; command logs are never overwritten") from None
            return os.open(path, flags)
    except OSError as error:
        raise ContidError(f"{path}: cannot write the command log: {error.strerror}") from error
