"""Sessions of several nodes in one file, on one clock, for looking at: replay takes the originals.

Channels are ``/NODE/tick`` and so on; ``log_time`` is the time of day of the conductor of a fleet run, from
the notes in the sessions, and ``publish_time`` the original. Metadata ``merged/NODE`` has file, offset and
bound.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, Final

from contid.errors import ContidError
from contid.session.format import mcap_records as mcap
from contid.session.format.mcap_records import MESSAGE_INSIDE
from contid.session.format.record_stream import RecordStream
from contid.session.read import Session
from contid.session.write import PRIVATE, exists_error
from contid.whole_file import replacing
from contid_sessions.clock_notes import ClockNotes, clock_notes
from contid_sessions.indexed_writer import IndexedWriter

#: Metadata by which a merged file is known.
MERGED: Final = "merged"


@dataclass(frozen=True, slots=True)
class MergeReport:
    """What was merged.

    Attributes:
        messages: number of messages by node.
        bound_s: largest error of a time against the conductor's, by node.
        start_s: first time after the earliest first time of all, by node.
    """

    messages: Mapping[str, int]
    bound_s: Mapping[str, float]
    start_s: Mapping[str, float]


@dataclass(slots=True)
class _Input:
    """A session that is merged, and its clock against the conductor's."""

    session: Session
    clock: ClockNotes

    @property
    def name(self) -> str:
        return self.clock.node

    def shifted_ns(self, log_ns: int) -> int:
        """A log time of the session on the conductor's time of day."""
        clock = self.session.metadata["clock"]
        wall_ns, monotonic_s = int(clock["wall_ns"]), float(clock["monotonic_s"])
        at_s = monotonic_s + (log_ns - wall_ns) * 1e-9
        # In integers as far as possible: a double has 0.2 us left at the time of day.
        shift_s = self.clock.wall_s - self.clock.offset_s(at_s)
        return round((monotonic_s + shift_s) * 1e9) + (log_ns - wall_ns)


def merge_sessions(paths: Sequence[Path], target: Path) -> MergeReport:
    """Merge sessions that took part in one fleet run.

    Raises:
        ContidError: one is no session, has no note of the conductor of the others, or two are of one node;
            the target exists or cannot be written.
    """
    if target.exists():
        raise exists_error(target)
    inputs = _inputs(paths)
    with ExitStack() as stack, replacing(target, PRIVATE) as out:
        files = [stack.enter_context(each.session.path.open("rb")) for each in inputs]
        return _write(out, inputs, files)


def _inputs(paths: Sequence[Path]) -> list[_Input]:
    if len(paths) < 2:
        raise ContidError("two sessions at least are merged")
    sessions = [Session(path) for path in paths]
    notes = [clock_notes(str(session.path), session.events()) for session in sessions]
    for session, found in zip(sessions, notes, strict=True):
        if not found:
            raise ContidError(
                f"{session.path}: no note of a fleet run: nothing relates its clock to those of the others "
                "(`contid fleet run` notes it)"
            )
    common = set.intersection(*(set(found) for found in notes))
    if not common:
        raise ContidError(
            "the sessions have no note of one conductor: their fleet runs were conducted elsewhere"
        )
    # The conductor that noted most.
    conductor = max(sorted(common), key=lambda name: sum(len(found[name].notes) for found in notes))
    wall_s = notes[0][conductor].wall_s
    inputs = []
    for session, found in zip(sessions, notes, strict=True):
        clock = found[conductor]
        inputs.append(_Input(session, ClockNotes(clock.node, conductor, clock.notes, wall_s)))
    names = [each.name for each in inputs]
    for name in names:
        if names.count(name) > 1:
            files = ", ".join(str(each.session.path) for each in inputs if each.name == name)
            raise ContidError(f"{files}: several sessions of node {name!r}; merge one of each node")
    return inputs


def _write(out: BinaryIO, inputs: Sequence[_Input], files: Sequence[BinaryIO]) -> MergeReport:
    from mcap import records

    writer = IndexedWriter(out)
    writer.add(records.Header("", mcap.LIBRARY))
    notes: dict[str, dict[str, str]] = {MERGED: {"nodes": ",".join(each.name for each in inputs)}}
    for each in inputs:
        clock = each.clock
        notes[f"{MERGED}/{each.name}"] = {
            "file": each.session.path.name,
            "conductor": clock.conductor,
            "experiments": ",".join(clock.experiments),
            "notes": str(len(clock.notes)),
            "offset_s": repr(clock.notes[0].offset_s),
            "last_offset_s": repr(clock.notes[-1].offset_s),
            "bound_s": repr(clock.bound_s),
        }
        notes[f"{each.name}/robot_file"] = each.session.metadata["robot_file"]
    for name, texts in notes.items():
        writer.add(records.Metadata(name=name, metadata=texts))
    counts = dict.fromkeys((each.name for each in inputs), 0)
    first: dict[str, int] = {}
    numbers = itertools.count(1)
    streams = (_messages(writer, numbers, *pair) for pair in zip(inputs, files, strict=True))
    for time_ns, name, body in heapq.merge(*streams, key=lambda message: message[0]):
        writer.message(body)
        counts[name] += 1
        first.setdefault(name, time_ns)
    writer.finish()
    begin_ns = min(first.values(), default=0)
    return MergeReport(
        counts,
        {each.name: each.clock.bound_s for each in inputs},
        {name: (time_ns - begin_ns) * 1e-9 for name, time_ns in first.items()},
    )


def _messages(
    writer: IndexedWriter, numbers: Iterator[int], each: _Input, file: BinaryIO
) -> Iterator[tuple[int, str, bytes]]:
    """Time on the common clock, node and body of every message; times do not decrease.

    Schemas and channels get the next of ``numbers``, and are written when they are met.
    """
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    newest_ns = 0
    for opcode, body in RecordStream(file):
        if opcode == mcap.SCHEMA:
            schema = mcap.decode(opcode, body)
            if schema.id not in schemas:
                schemas[schema.id] = next(numbers)
                writer.add(replace(schema, id=schemas[schema.id], name=f"{each.name}/{schema.name}"))
        elif opcode == mcap.CHANNEL:
            found = mcap.decode(opcode, body)
            if found.id not in channels:
                channels[found.id] = next(numbers)
                topic, schema_id = f"/{each.name}/{found.topic}", schemas.get(found.schema_id, 0)
                writer.add(replace(found, id=channels[found.id], topic=topic, schema_id=schema_id))
        elif opcode == mcap.MESSAGE:
            channel, sequence, log_ns, _ = MESSAGE_INSIDE.unpack_from(body)
            newest_ns = max(newest_ns, each.shifted_ns(log_ns))
            head = MESSAGE_INSIDE.pack(channels[channel], sequence, newest_ns, log_ns)
            yield newest_ns, each.name, head + body[MESSAGE_INSIDE.size :]
