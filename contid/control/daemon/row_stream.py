"""The live stream on stdin: the newest row is the target; a wrong row holds its robots and is told."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Callable
from typing import Final

from contid.control.daemon.inputs import Stream
from contid.control.engine.messages import Message, Rows
from contid.control.tick.preflight import Preflight
from contid.errors import BadInputError

#: A line longer than this is no row.
MAX_LINE: Final = 1 << 16
CUT: Final = "the last row has no end of line and may be cut off: not followed"


class LiveRowReader:
    """Turns the lines of a stream into rows that may be followed."""

    def __init__(self, stream: Stream, preflight: Preflight | None, say: Callable[[str], None]) -> None:
        """Read a stream.

        Args:
            stream: with its header read.
            preflight: refuses rows out of reach and what a chain forbids; None lets everything pass.
            say: takes what is wrong with a row.
        """
        self._name = stream.name
        self._parser = stream.parser
        self._preflight = preflight
        self._say = say

    def ends(self, line: str, number: int) -> bool:
        """True for a last line without its end: of ``50,75`` a producer that was killed may leave ``50,7``.

        An object of JSON is whole or none, so it needs no end of line.
        """
        if line.endswith("\n") or self._parser.first_line_is_row or not line.strip():
            return False
        self._say(f"{self._name}:{number}:1: {CUT}")
        return True

    def row(self, line: str, number: int) -> Rows | None:
        """What a line means, None for a comment; the robots of a wrong row hold until their next good one."""
        try:
            row = self._parser.parse(line, number)
        except BadInputError as error:
            self._say(f"{error}; holding")
            return Rows(dict.fromkeys(self._parser.robots))
        if row is None:
            return None
        wrong = {} if self._preflight is None else self._preflight.row(row)
        for message in dict.fromkeys(wrong.values()):  # a chain says the same of both its arms
            self._say(f"{self._name}:{number}:1: {message}; holding")
        return Rows({**row, **dict.fromkeys(wrong)})


async def follow_stream(stream: Stream, reader: LiveRowReader, send: Callable[[Message], None]) -> None:
    """Send every row of a stream to the control process until the stream ends."""
    for number, line in stream.pending:
        _send(reader.row(line, number), send)
    number = stream.number
    async for line in _lines(stream.descriptor):
        number += 1
        if reader.ends(line, number):
            return
        _send(reader.row(line, number), send)


def _send(row: Rows | None, send: Callable[[Message], None]) -> None:
    if row is not None:
        send(row)


async def _lines(descriptor: int) -> AsyncIterator[str]:
    """Lines of a descriptor that a selector can watch, until its end; the last one may lack its own."""
    loop = asyncio.get_running_loop()
    ready = asyncio.Event()
    blocking = os.get_blocking(descriptor)
    os.set_blocking(descriptor, False)
    loop.add_reader(descriptor, ready.set)
    buffer = b""
    try:
        while True:
            await ready.wait()
            ready.clear()
            try:
                chunk = os.read(descriptor, MAX_LINE)
            except BlockingIOError:
                continue
            buffer += chunk
            *lines, buffer = buffer.split(b"\n")
            for line in lines:
                yield line.decode("utf-8", errors="replace") + "\n"
            if not chunk:
                if buffer:
                    yield buffer.decode("utf-8", errors="replace")
                return
            if len(buffer) > MAX_LINE:  # wrong, and told as such
                yield buffer.decode("utf-8", errors="replace") + "\n"
                buffer = b""
    finally:
        loop.remove_reader(descriptor)
        os.set_blocking(descriptor, blocking)
