"""Every command of a run as CSV with exact floats, so that two runs can be compared byte for byte.

Columns: ``tick,source_s`` and per robot ``NAME.mode``, per axis ``NAME.AXIS.command`` [m or Pa] and
``NAME.AXIS.device`` [rad or Pa]; empty where nothing was commanded. Numbers are written with the fewest
digits that read back to the same float64.
"""

from __future__ import annotations

import math
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from contid.control.engine.events import RunEvent
from contid.control.engine.tick_layout import RecordLayout, TickRecord
from contid.control.tick.supervisor import Mode
from contid.errors import ContidError


class CommandLog:
    """Writes records as lines; also a sink of the engine in virtual time."""

    def __init__(self, path: Path, layout: RecordLayout) -> None:
        """Create the file and write the names of the columns.

        Raises:
            ContidError: it exists, or cannot be written.
        """
        self._path = path
        self._layout = layout
        self._file = os.fdopen(_created(path), "w", encoding="ascii", newline="\n", buffering=1)
        columns = ["tick", "source_s"]
        for robot in layout.robots:
            columns.append(f"{robot.name}.mode")
            for axis in robot.axes:
                columns += [f"{robot.name}.{axis}.command", f"{robot.name}.{axis}.device"]
        with self._named_errors():
            self._file.write(",".join(columns) + "\n")

    def add(self, record: TickRecord) -> None:
        """Write one line for one tick.

        Raises:
            OSError: it cannot be written, such as to a full disk or a pipe that is not read any more.
        """
        cells = [str(record.tick), _exact(record.source_s)]
        for robot in record.robots:
            cells.append(Mode(robot.mode).name)
            for axis in robot.axes:
                cells += [_exact(axis.command), _exact(axis.device)]
        self._file.write(",".join(cells) + "\n")

    def write(self, values: list[float]) -> None:
        """See `contid.control.engine.cycle.Sink`.

        Raises:
            ContidError: the line cannot be written.
        """
        with self._named_errors():
            self.add(self._layout.decode(tuple(values)))

    def event(self, event: RunEvent) -> None:
        """Events are not commands."""

    def close(self) -> None:
        """Finish the file."""
        self._file.close()

    @contextmanager
    def _named_errors(self) -> Iterator[None]:
        """Close the file after an error of the system, and raise it as one of this file."""
        try:
            yield
        except OSError as error:
            with suppress(OSError):
                self._file.close()
            raise _cannot_write(self._path, error) from error


def _exact(value: float) -> str:
    """The shortest text that reads back to the same number; empty for NaN, which is no command."""
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
        raise _cannot_write(path, error) from error


def _cannot_write(path: Path, error: OSError) -> ContidError:
    return ContidError(f"{path}: cannot write the command log: {error.strerror}")
