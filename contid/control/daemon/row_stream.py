"""The live stream on stdin: the newest row is the target; a wrong row holds its robots and is reported."""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import AsyncIterator, Callable
from typing import Final

from contid.control.daemon.inputs import Stream
from contid.control.engine.messages import Message, Rows
from contid.control.tick.preflight import Preflight
from contid.errors import BadInputError
from contid.lines import MAX_LINE

CUT: Final = "the last row has no end of line and may be cut off: not followed"

log = logging.getLogger(__name__)


class LiveRowReader:
    """Turns the lines of a stream into checked rows."""

    def __init__(self, stream: Stream, preflight: Preflight | None) -> None:
        """Read a stream.

        Args:
            stream: after its header.
            preflight: refuses rows out of reach or forbidden by a chain; None accepts every row.
        """
        self._name = stream.name
        self._parser = stream.parser
        self._preflight = preflight

    def ends(self, line: str, number: int) -> bool:
        """True for a last line without end of line: a killed producer may leave ``50,7`` of ``50,75``.

        JSON needs no end of line: a part of an object does not parse.
        """
        if line.endswith("\n") or self._parser.is_json or not line.strip():
            return False
        log.warning(f"{self._name}:{number}:1: {CUT}")
        return True

    def row(self, line: str, number: int) -> Rows | None:
        """The row of a line, None for a comment; robots of a wrong row hold until their next good one."""
        try:
            row = self._parser.targets(line, number)
        except BadInputError as error:
            log.warning(f"{error}; holding")
            return Rows(dict.fromkeys(self._parser.robots))
        if row is None:
            return None
        wrong = {} if self._preflight is None else self._preflight.row(row)
        for message in dict.fromkeys(wrong.values()):  # one message for both arms of a chain
            log.warning(f"{self._name}:{number}:1: {message}; holding")
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
    """Lines of a descriptor that a selector can watch; the last one may lack its end of line."""
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
            if len(buffer) > MAX_LINE:  # the parser rejects it
                yield buffer.decode("utf-8", errors="replace") + "\n"
                buffer = b""
    finally:
        loop.remove_reader(descriptor)
        os.set_blocking(descriptor, blocking)
