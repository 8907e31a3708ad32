"""The live stream on stdin: the newest row is the target; a wrong row holds its robots and is told."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Callable
from typing import Final

from contid.control.inputs import Stream
from contid.control.messages import Message, Rows
from contid.control.preflight import Preflight
from contid.errors import BadInputError
from contid.targets import Target

#: A line longer than this is no row.
MAX_LINE: Final = 1 << 16
CUT: Final = "the last row has no end of line and may be cut off: not followed"


async def follow_stream(
    stream: Stream,
    send: Callable[[Message], None],
    preflight: Preflight | None,
    say: Callable[[str], None],
) -> None:
    """Send every row of a stream until it ends.

    Args:
        stream: with its header read.
        send: to the control process.
        preflight: refuses rows out of reach and what a chain forbids; None lets everything pass.
        say: takes what is wrong with a row.
    """
    robots = stream.parser.robots
    for number, line in stream.pending:
        take_row(stream, line, number, send, preflight, say, robots)
    number = stream.number
    async for line in _lines(stream.descriptor):
        number += 1
        if may_be_cut(stream, line):
            say(f"{stream.name}:{number}:1: {CUT}")
            return
        take_row(stream, line, number, send, preflight, say, robots)


def may_be_cut(stream: Stream, line: str) -> bool:
    """True for a last line without its end: of ``50,75`` a producer that was killed may leave ``50,7``.

    An object of JSON is whole or none, so it needs no end of line.
    """
    return not (line.endswith("\n") or stream.parser.first_line_is_row or not line.strip())


def take_row(
    stream: Stream,
    line: str,
    number: int,
    send: Callable[[Message], None],
    preflight: Preflight | None,
    say: Callable[[str], None],
    robots: tuple[str, ...],
) -> None:
    """One line: sent when it is good, otherwise the robots it was for hold until their next good row."""
    try:
        row = stream.parser.parse(line, number)
    except BadInputError as error:
        say(f"{error}; holding")
        send(Rows(dict.fromkeys(robots)))
        return
    if row is None:
        return
    wrong = {} if preflight is None else preflight.row(row)
    targets: dict[str, Target | None] = dict(row)
    for words in dict.fromkeys(wrong.values()):  # a chain says the same of both its arms
        say(f"{stream.name}:{number}:1: {words}; holding")
    targets.update(dict.fromkeys(wrong))
    send(Rows(targets))


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
