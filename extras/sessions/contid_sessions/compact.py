"""Compaction of a session: compressed chunks, an index, statistics, and the channel of measured tips.

Message records are copied as bytes; only their heads are decoded, and what the channel `measured` is computed
from (`contid_sessions.measured_channel`). The new file replaces the old one in one step, so that a readable
session exists at every instant.

A repair is such a copy: a truncated session gets an end and an index, a damaged one a copy of its valid part.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path

from contid.errors import SessionError
from contid.session.format import mcap_records as mcap
from contid.session.format.channels import CHANNELS, EVENT, TICK_CHANNELS
from contid.session.format.entries import DAMAGED, GROWING
from contid.session.format.record_stream import RecordStream
from contid.session.write import MOVED, PRIVATE, exists_error
from contid.whole_file import replacing
from contid_sessions.indexed_writer import IndexedWriter
from contid_sessions.measured_channel import MeasuredChannel, ModelFailedError

log = logging.getLogger(__name__)


def compact(
    source: Path,
    target: Path | None = None,
    note: Mapping[str, Mapping[str, str]] | None = None,
    max_entries: int | None = None,
) -> Path:
    """Rewrite a session, whole or truncated, as an indexed and compressed one.

    Args:
        source: the session.
        target: a file that does not exist; None replaces ``source``.
        note: metadata to add, by name.
        max_entries: number of ticks and events to copy, as `contid.session.read.Session.entries` counts them;
            None for all.

    Returns:
        The new file.

    Raises:
        ContidError: ``target`` exists or cannot be written, or ``source`` is damaged, and
            ``max_entries`` does not end the copy before that; ``source`` is unchanged.
    """
    if target is not None and target.exists():
        raise exists_error(target)
    target = target or source
    for with_measured in (True, False):
        try:
            measured = MeasuredChannel.of(source) if with_measured else None
            with replacing(target, PRIVATE) as new, source.open("rb") as old:
                stream = RecordStream(old)
                _Compactor(IndexedWriter(new), max_entries, measured).copy(stream, note or {})
                if stream.damage and max_entries is None:  # the copy would be whole, without what follows
                    raise SessionError(f"{source}: {DAMAGED} ({stream.damage})")
                if target == source and not os.path.samestat(source.stat(), os.fstat(old.fileno())):
                    raise SessionError(f"{source}: {MOVED}")
            break
        except ModelFailedError as error:  # the recording is worth more than what is computed from it
            log.warning("%s: without the channel measured: %s", source, error)
    return target


class _Compactor:
    """One copy; ticks that are not whole are left out."""

    def __init__(
        self, writer: IndexedWriter, max_entries: int | None, measured: MeasuredChannel | None
    ) -> None:
        self._writer, self._measured = writer, measured
        self._max_entries, self._entries, self._declared = max_entries, 0, False
        self._topics: dict[int, str] = {}
        #: Topics and messages of a tick, until the last of its channels completes it.
        self._tick: list[tuple[str, bytes]] = []

    def copy(self, stream: RecordStream, note: Mapping[str, Mapping[str, str]]) -> None:
        """Copy every whole record and tick, and finish the file."""
        from mcap import records

        copied: set[tuple[int, int]] = set()
        for opcode, body in stream:
            number = int.from_bytes(body[:2], "little")
            if opcode == mcap.MESSAGE:
                topic = self._topics.get(number, "")
                if topic in CHANNELS and self._entries == self._max_entries:
                    break
                self._add_message(topic, body)
                continue
            if opcode in (mcap.SCHEMA, mcap.CHANNEL):
                if (opcode, number) in copied:
                    continue
                copied.add((opcode, number))
            if opcode == mcap.METADATA and mcap.decode(opcode, body).name == mcap.CHECKSUM:
                continue  # the end of the data has one for the whole file
            if opcode == mcap.CHANNEL:
                self._topics[number] = mcap.decode(opcode, body).topic
            self._writer.record(opcode, body)
        for name, texts in note.items():
            self._writer.add(records.Metadata(name=name, metadata=dict(texts)))
        self._writer.finish()

    def _add_message(self, topic: str, body: bytes) -> None:
        if topic == TICK_CHANNELS[0]:
            self._tick = [(topic, body)]
        elif topic in TICK_CHANNELS:
            if self._tick:
                self._tick.append((topic, body))
                if topic == TICK_CHANNELS[-1]:
                    self._write_tick()
        else:
            self._writer.message(body)
            self._entries += topic == EVENT

    def _write_tick(self) -> None:
        """Write the messages of a whole tick, and what is computed from them."""
        writer, measured = self._writer, self._measured
        for _, each in self._tick:
            writer.message(each)
        if measured is not None:
            for declared in measured.declaration() if not self._declared else ():
                writer.add(declared)
            self._declared = True
            writer.message(measured.message(dict(self._tick)))
        self._tick = []
        self._entries += 1


def repair(source: Path, output: Path | None, progress: Callable[[int], None] = lambda ticks: None) -> str:
    """Rewrite a session; a complete one is unchanged unless ``output`` is given.

    Args:
        source: the session.
        output: a file that does not exist; None replaces ``source``.
        progress: called with the number of ticks read.

    Returns:
        A line for the user.

    Raises:
        ContidError: it is still being recorded; it is damaged inside and ``output`` is None; ``output``
            exists or cannot be written.
    """
    from contid.session.read import Session
    from contid_sessions.info import summarize  # with numpy, which the recorder does without

    session = Session(source, progress)
    before = summarize(session)
    end = session.end
    if end.clean and end.compacted and output is None:
        return f"{source}: nothing to repair"
    if end.cut == GROWING:
        raise SessionError(f"{source}: {GROWING}; nothing to repair before the run has ended")
    if end.cut == DAMAGED and output is None:
        raise SessionError(
            f"{source}: {DAMAGED} after {before.ticks} ticks ({end.damage}); give --output for a copy of the "
            "part before it; this file keeps the rest"
        )
    when = datetime.now(UTC).isoformat(timespec="seconds")
    note = {} if end.clean else {"repaired": {"when": when, "found": end.cut}}
    read = before.ticks + sum(before.events.values())
    target = compact(source, output, note, read if end.cut == DAMAGED else None)
    after = summarize(Session(target, progress))
    return f"{target}: {after.ticks} of {before.ticks} ticks, {after.state}"
