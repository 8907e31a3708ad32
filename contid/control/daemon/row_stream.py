"""The live stream on stdin: the newest row is the target; a wrong row holds its robots and is reported.

Rows that arrive together are followed in order for `BUDGET_S`; then all but the newest are skipped, and the
stream pauses. So a producer without a pace delays neither an order of a client nor Ctrl-C.
"""

from __future__ import annotations

import asyncio
import io
import logging
import os
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from typing import Final

from contid.control.daemon.inputs import Stream
from contid.control.engine.messages import Message, Rows
from contid.control.engine.report import RunReport
from contid.control.tick.preflight.rows import Preflight
from contid.errors import BadInputError
from contid.trajectory.lines import CUT, is_comment
from contid.units import MAX_LINE

#: Time for rows that arrived together, less than a tick of 200 Hz. A row of a finger takes 0.1 ms; a machine
#: that stood still for 150 ms leaves thirty at 200 Hz. Rows that are skipped are lost to the path.
BUDGET_S: Final = 4e-3
#: Pause after a turn that used its time, or as long as the turn took: the event loop serves the others.
PAUSE_S: Final = 5e-3

log = logging.getLogger(__name__)


def ends(stream: Stream, line: str, number: int) -> bool:
    """True for a last line without end of line: a killed producer may leave ``50,7`` of ``50,75``.

    JSON needs no end of line: a part of an object does not parse.
    """
    if line.endswith("\n") or stream.parser.is_json or not line.strip():
        return False
    log.warning(f"{stream.name}:{number}:1: {CUT}")
    stream.cut = True
    return True


class LiveRowReader:
    """Turns the lines of a stream into checked rows, and counts them.

    Attributes:
        stream: that they are of.
        rows, refused, followed: all, those that held a robot, those that gave a robot a target.
        held: robots that their newest row held.
    """

    def __init__(self, stream: Stream, preflight: Preflight | None) -> None:
        """Read a stream.

        Args:
            stream: after its header.
            preflight: refuses rows out of reach or forbidden by a chain; None accepts every row.
        """
        self.stream = stream
        self._parser = stream.parser
        self._preflight = preflight
        self.rows = self.refused = self.followed = 0
        self.held: set[str] = set()

    def row(self, line: str, number: int) -> Rows | None:
        """The row of a line, None for a comment; robots of a wrong row hold until their next good one."""
        try:
            row = self._parser.targets(line, number)
        except BadInputError as error:
            log.warning(f"{error}; holding")
            self._count(refused=True, followed=False)
            self.held.update(self._parser.robots)
            return Rows(dict.fromkeys(self._parser.robots))
        if row is None:
            return None
        wrong = {} if self._preflight is None else self._preflight.row(row)
        self._count(refused=bool(wrong), followed=len(wrong) < len(row))
        self.held = self.held - row.keys() | wrong.keys()
        for message in dict.fromkeys(wrong.values()):  # one message for both arms of a chain
            log.warning(f"{self.stream.name}:{number}:1: {message}; holding")
        return Rows({**row, **dict.fromkeys(wrong)})

    def _count(self, refused: bool, followed: bool) -> None:
        self.rows += 1
        self.refused += refused
        self.followed += followed

    def complete(self, report: RunReport) -> None:
        """Add what was refused to the report of a run; without its last row, or any, it has not succeeded."""
        if self.refused:
            report.problems.append(f"{self.stream.name}: {self.refused} of {self.rows} rows held robots")
        if not self.followed and not report.exit_code:
            report.ending, report.exit_code = f"{self.stream.name}: no row could be followed", 2
        elif (self.held or self.stream.cut) and not report.exit_code:
            of = f" of {', '.join(sorted(self.held))}" if self.held else ""
            report.ending, report.exit_code = f"{self.stream.name}: the last row{of} was not followed", 2


class StreamFollower:
    """Sends the rows of a stream to the control process."""

    def __init__(
        self,
        stream: Stream,
        read: Callable[[str, int], Awaitable[Message | None]],
        send: Callable[[Message], None],
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """Follow a stream; ``read`` is `LiveRowReader.row`, in a thread where that asks isolated models."""
        self._stream = stream
        self._read = read
        self._send = send
        self._now = now
        self._number = stream.number
        self._skipped = False

    async def follow(self) -> None:
        """Follow until the stream ends."""
        for number, line in self._stream.pending:
            if ends(self._stream, line, number):
                return
            await self._row(line, number)
        async for lines in _lines(self._stream.descriptor):
            if lines and ends(self._stream, lines[-1], self._number + len(lines)):
                await self._turn(lines[:-1])
                return
            started_s = self._now()
            if not await self._turn(lines):
                await asyncio.sleep(max(PAUSE_S, self._now() - started_s))

    async def _turn(self, lines: Sequence[str]) -> bool:
        """Follow lines that arrived together; False when the time was used."""
        end_s = self._now() + BUDGET_S
        for index, line in enumerate(lines):
            self._number += 1
            await self._row(line, self._number)
            if self._now() >= end_s:
                await self._newest(lines[index + 1 :])
                return False
        return True

    async def _newest(self, lines: Sequence[str]) -> None:
        """Follow the last row only."""
        first = self._number + 1
        self._number += len(lines)
        rows = (index for index in reversed(range(len(lines))) if not is_comment(lines[index]))
        newest = next(rows, None)
        if newest is None:
            return
        if not self._skipped and next(rows, None) is not None:
            self._skipped = True
            log.warning(
                f"{self._stream.name}:{first}:1: rows come faster than they can be checked; some are skipped"
            )
        await self._row(lines[newest], first + newest)

    async def _row(self, line: str, number: int) -> None:
        row = await self._read(line, number)
        if row is not None:
            self._send(row)


async def _lines(descriptor: int) -> AsyncIterator[list[str]]:
    """Lines of a descriptor that a selector can watch, as they arrive; the last may lack its end of line."""
    loop = asyncio.get_running_loop()
    ready = asyncio.Event()
    blocking = os.get_blocking(descriptor)
    os.set_blocking(descriptor, False)
    buffer, cut = b"", False
    try:
        while True:
            # Watched only while waiting: a full pipe would wake the loop during a pause without end.
            loop.add_reader(descriptor, ready.set)
            await ready.wait()
            loop.remove_reader(descriptor)
            ready.clear()
            try:
                chunk = os.read(descriptor, MAX_LINE)
            except BlockingIOError:
                continue
            *complete, buffer = (buffer + chunk).split(b"\n")
            if cut:  # the rest of a line that was given already
                cut = not complete
                complete, buffer = complete[1:], b"" if cut else buffer
            # 64 kB may have ten thousand lines: divided in one call, at line feeds only.
            text = b"\n".join((*complete, b""))
            lines = io.StringIO(text.decode("utf-8", errors="replace"), newline="\n").readlines()
            if not chunk:
                if buffer:
                    lines.append(buffer.decode("utf-8", errors="replace"))
            elif len(buffer) > MAX_LINE:  # the parser rejects it
                lines.append(buffer.decode("utf-8", errors="replace") + "\n")
                buffer, cut = b"", True
            yield lines
            if not chunk:
                return
    finally:
        loop.remove_reader(descriptor)
        os.set_blocking(descriptor, blocking)
