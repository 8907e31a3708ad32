"""The input of `contid run`: a timed trajectory read to its end, or the lines of a live stream.

A header with ``t_s`` makes it timed. A file is always timed; a live stream comes from a pipe, a socket or a
terminal, and its rows apply when they arrive.
"""

from __future__ import annotations

import io
import os
import select
import stat
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TextIO

from contid.errors import BadInputError, ContidError, Located
from contid.robot_file.robot import RobotDescription
from contid.trajectory.lines import HeaderSearch
from contid.trajectory.read import read_trajectory
from contid.trajectory.rows import RowReader
from contid.trajectory.timed import Trajectory
from contid.units import MAX_LINE

#: Bytes of a timed trajectory per read.
CHUNK: Final = 1 << 20
#: Bytes of a line before the rows: more of them are more characters than a header may have (`MAX_LINE`).
_MOST_BYTES: Final = 4 * MAX_LINE


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


@dataclass(slots=True)
class Stream:
    """A live stream after its header.

    Attributes:
        parser: of its lines.
        name: for messages.
        descriptor: of the following bytes.
        pending: lines already read, with their numbers.
        number: of the last line read.
        cut: its last row had no end of line.
    """

    parser: RowReader
    name: str
    descriptor: int
    pending: tuple[tuple[int, str], ...]
    number: int
    cut: bool = False


def read_file(path: str, robots: Mapping[str, RobotDescription]) -> Trajectory:
    """Read the timed trajectory of a file."""
    try:
        # Bytes that are not UTF-8 become characters that fail to parse, with their line and column.
        with Path(path).open(encoding="utf-8", errors="replace") as file:
            return read_trajectory(file, path, robots)
    except OSError as error:
        raise ContidError(f"{path}: cannot be read: {error.strerror}") from error


def has_input(stdin: TextIO | None) -> bool:
    """True when stdin is an input: not a terminal, not ``/dev/null``, not closed."""
    if stdin is None or stdin.closed or stdin.isatty():
        return False
    found = os.fstat(stdin.fileno())
    return not (stat.S_ISCHR(found.st_mode) and found.st_rdev == Path(os.devnull).stat().st_rdev)


def read_stdin(
    stdin: TextIO, robots: Mapping[str, RobotDescription], reader: CancellableReader
) -> Trajectory | Stream:
    """Read stdin: a timed trajectory to its end, or the header of a stream.

    Raises:
        BadInputError: a wrong header, or a trajectory with mistakes.
        ContidError: it ended without a line, or cannot be read.
        InputCancelledError: the reader was cancelled.
    """
    descriptor = stdin.fileno()
    name = "stdin"
    head = ""
    search = HeaderSearch()
    for number, raw in _lines(descriptor, reader):
        line = raw.decode("utf-8", errors="replace")
        if number == 1:
            line = line.removeprefix("\ufeff")  # it would hide that a comment is one
        head += line
        header = search.take(number, line)
        if header is None:
            continue
        parser = RowReader(header.text, name, robots, header.number)
        if parser.timed:
            return _read_timed(descriptor, head, robots, reader)
        if stat.S_ISREG(os.fstat(descriptor).st_mode):
            message = "no column 't_s': a file needs times; send a live stream through a pipe"
            raise BadInputError([Located(name, number, 1, message)])
        return Stream(parser, name, descriptor, ((number, line),) if header.on_row else (), number)
    raise ContidError(
        "stdin: no trajectory came in: it ended before its first line, and nothing was moved; "
        "check the command before the pipe, or give < /dev/null to hold and wait for orders"
    )


def _read_timed(
    descriptor: int, head: str, robots: Mapping[str, RobotDescription], reader: CancellableReader
) -> Trajectory:
    rest = bytearray()
    while chunk := _read(descriptor, CHUNK, reader):
        rest += chunk
    # As in a file (`read_file`): bytes that are not UTF-8 are refused where they stand, unless in a comment.
    return read_trajectory(io.StringIO(head + rest.decode("utf-8", errors="replace")), "stdin", robots)


def _read(descriptor: int, size: int, reader: CancellableReader) -> bytes:
    try:
        return reader.read(descriptor, size)
    except OSError as error:  # a connection that was reset; a descriptor for writing
        raise ContidError(f"stdin: cannot be read: {error.strerror}") from error


def _lines(descriptor: int, reader: CancellableReader) -> Iterator[tuple[int, bytes]]:
    """Lines, read byte by byte: what follows the header is left in the descriptor.

    A line longer than `_MOST_BYTES` comes before its end, without its rest: that of ``/dev/zero`` has no end.
    """
    line, number, cut = bytearray(), 1, False
    while byte := _read(descriptor, 1, reader):
        end = byte == b"\n"
        if not cut:
            line += byte
            cut = not end and len(line) > _MOST_BYTES
            if end or cut:
                yield number, bytes(line) if end else bytes(line) + b"\n"
        if end:
            line.clear()
            number += 1
            cut = False
    if line and not cut:
        yield number, bytes(line)
