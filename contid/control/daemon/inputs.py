"""What `contid run` follows: a timed trajectory read to its end, or the lines of a live stream.

Which of the two is decided by the header: with ``t_s`` it is timed. A file is always timed; a live stream is
read from a pipe, a socket or a terminal, where a line arrives when it is meant.
"""

from __future__ import annotations

import io
import os
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TextIO

from contid.control.daemon.cancellable_reader import CancellableReader
from contid.errors import BadInputError, ContidError, Located
from contid.robot_file.robot import RobotDescription
from contid.trajectory.read import read_trajectory
from contid.trajectory.stream import StreamParser
from contid.trajectory.timed import Trajectory

#: Bytes of a timed trajectory that are read at a time.
CHUNK: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class Stream:
    """A live stream whose header was read.

    Attributes:
        parser: of its lines.
        name: what messages call it.
        descriptor: where its further bytes come from.
        pending: lines read already, with their numbers.
        number: of the last line read.
    """

    parser: StreamParser
    name: str
    descriptor: int
    pending: tuple[tuple[int, str], ...]
    number: int


def read_file(path: str, robots: Mapping[str, RobotDescription]) -> Trajectory:
    """The timed trajectory of a file; ``-`` is not one."""
    try:
        # What is no UTF-8 becomes a character that is no number and no column: a finding with its place.
        with Path(path).open(encoding="utf-8", errors="replace") as file:
            return read_trajectory(file, path, robots)
    except OSError as error:
        raise ContidError(f"{path}: cannot read it: {error.strerror}") from error


def given(stdin: TextIO | None) -> bool:
    """True when stdin is meant as an input: no terminal, not ``/dev/null``, not closed."""
    if stdin is None or stdin.closed or stdin.isatty():
        return False
    found = os.fstat(stdin.fileno())
    return not (stat.S_ISCHR(found.st_mode) and found.st_rdev == Path(os.devnull).stat().st_rdev)


def read_stdin(
    stdin: TextIO, robots: Mapping[str, RobotDescription], patience: CancellableReader
) -> Trajectory | Stream:
    """What stdin holds: a trajectory that was read to its end, or a stream whose header was.

    Raises:
        BadInputError: a wrong header, or a trajectory with mistakes.
        ContidError: it ended without a line.
        GivenUpError: nobody waits any more.
    """
    descriptor = stdin.fileno()
    name = "stdin"
    skipped: list[str] = []
    for number, raw in _lines(descriptor, patience):
        line = raw.decode("utf-8", errors="replace")
        if not line.strip() or line.lstrip().startswith("#"):
            skipped.append(line)
            continue
        parser = StreamParser(line, name, robots, number)
        if parser.timed:
            return _read_timed(descriptor, "".join(skipped) + line, robots, patience)
        if stat.S_ISREG(os.fstat(descriptor).st_mode):
            message = "no column 't_s': a file needs times; a live stream comes through a pipe"
            raise BadInputError([Located(name, number, 1, message)])
        pending = ((number, line),) if parser.first_line_is_row else ()
        return Stream(parser, name, descriptor, pending, number)
    raise ContidError(
        "stdin: no trajectory came in: it ended before its first line, so nothing was moved; "
        "see what the command before the pipe says, or give < /dev/null to hold and wait for orders"
    )


def _read_timed(
    descriptor: int, head: str, robots: Mapping[str, RobotDescription], patience: CancellableReader
) -> Trajectory:
    rest = bytearray()
    while chunk := patience.read(descriptor, CHUNK):
        rest += chunk
    try:
        text = rest.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ContidError(f"stdin: not UTF-8 text: {error}") from error
    return read_trajectory(io.StringIO(head + text), "stdin", robots)


def _lines(descriptor: int, patience: CancellableReader) -> Iterator[tuple[int, bytes]]:
    """Lines byte by byte: what comes after the header belongs to whoever reads on."""
    line, number = bytearray(), 1
    while byte := patience.read(descriptor, 1):
        line += byte
        if byte == b"\n":
            yield number, bytes(line)
            line.clear()
            number += 1
    if line:
        yield number, bytes(line)
