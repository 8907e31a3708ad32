"""Ticks and events of a file in their order, up to its end or to the first damage.

The orders and answers of a tick come before its record (the recorder fetches events first), so one pass
forward is enough for a replay.
"""

from __future__ import annotations

import fcntl
import json
import struct
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final

from contid.control.engine.events import RunEvent
from contid.control.engine.events.json_form import from_json
from contid.session.format import mcap_records as mcap
from contid.session.format.channels import EVENT, RENAMED_EVENT_KEYS, TICK_CHANNELS
from contid.session.format.decode import MAX_COUNT, Decoder
from contid.session.format.mcap_records import MESSAGE_INSIDE, DamagedRecordError
from contid.session.format.record_stream import RecordStream

#: `EndOfFile.cut` of a file that has no end yet.
GROWING: Final = "still being recorded"
#: `EndOfFile.cut` of a file with damage before its end; what follows the damage is not read.
DAMAGED: Final = "damaged inside"
#: Ticks between two calls of ``progress``.
_PROGRESS_TICKS: Final = 1000
#: Exceptions of a damaged message.
_DAMAGE: Final = (
    *(ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError),
    *(struct.error, DamagedRecordError),
)


@dataclass(frozen=True, slots=True)
class Entry:
    """One tick or one event.

    Attributes:
        time_ns: time of day since 1970 [ns].
        values: flat numbers of the record (`RecordLayout`) for a tick, None for an event.
        event: the event, None for a tick.
    """

    time_ns: int
    values: list[float] | None = None
    event: RunEvent | None = None


@dataclass(frozen=True, slots=True)
class EndOfFile:
    """How a file ends.

    Attributes:
        clean: True when it ends with the footer that MCAP demands.
        compacted: True when it was compacted, which compresses and indexes its messages.
        cut: why reading stopped before a footer, "" when it is clean.
        damage: what is damaged and where, "" unless ``cut`` is `DAMAGED`.
    """

    clean: bool = False
    compacted: bool = False
    cut: str = ""
    damage: str = ""


def read_entries(
    path: Path,
    topics: Mapping[int, str],
    decoder: Decoder,
    keep: Callable[[int, bytes], None],
    progress: Callable[[int], None],
) -> Generator[Entry, None, EndOfFile]:
    """Read a file once; a partial tick is left out.

    Args:
        path: path of the file.
        topics: topics by number of the channel; ``keep`` may add to it.
        decoder: decodes the messages of ticks.
        keep: called with the opcode and the body of every record that is no message.
        progress: called with the number of ticks read, every thousand ticks.

    Yields:
        Ticks and events in the order of the file.

    Returns:
        How the file ends; damage ends the reading and is no exception.
    """
    first, last = TICK_CHANNELS[0], TICK_CHANNELS[-1]
    header, header_size = MESSAGE_INSIDE, MESSAGE_INSIDE.size
    gathered: list[Any] | None = None
    ticks = 0
    with path.open("rb") as file:
        stream = RecordStream(file)
        for opcode, body in stream:
            try:
                if opcode != mcap.MESSAGE:
                    keep(opcode, body)
                    continue
                channel, _, time_ns, _ = header.unpack_from(body)
                topic = topics.get(channel)
                if topic == EVENT:
                    yield Entry(time_ns, None, _event(body[header_size:]))
                    continue
                if topic == first:
                    gathered = []
                if gathered is None or topic is None:
                    continue
                decoder.gather(gathered, topic, body[header_size:])
                if topic != last:
                    continue
                values = decoder.record(gathered)
            except _DAMAGE as error:
                return EndOfFile(cut=DAMAGED, damage=f"a record without valid content: {error}")
            yield Entry(time_ns, values)
            gathered = None
            ticks += 1
            if ticks % _PROGRESS_TICKS == 0:
                progress(ticks)
        if stream.damage:
            return EndOfFile(cut=DAMAGED, damage=stream.damage)
        if stream.clean:
            return EndOfFile(clean=True, compacted=stream.compacted)
        if _locked(file):
            return EndOfFile(cut=GROWING)
    cut = "it has no end" if gathered is None else "the last tick is not whole"
    return EndOfFile(compacted=stream.compacted, cut=cut)


def _event(data: bytes) -> RunEvent:
    """The event of a message.

    Raises:
        ValueError: it has no kind, or its tick is not a number.
    """
    fields = json.loads(data)
    if not isinstance(fields, dict) or not isinstance(fields.get("event"), str):
        raise ValueError("an event has no kind")
    tick = fields.get("tick", 0)
    if not isinstance(tick, int) or isinstance(tick, bool) or not 0 <= tick < MAX_COUNT:
        raise ValueError("an event has no tick")
    for old, new in RENAMED_EVENT_KEYS.items():
        if old in fields:
            fields[new] = fields.pop(old)
    return from_json(fields)


def _locked(file: BinaryIO) -> bool:
    """True while a recorder writes the file (`contid.session.write`)."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # a file system without locks
        return False
    return False  # closing the file unlocks it
