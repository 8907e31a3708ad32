"""A reader of a ring with its own position; it counts what was overwritten before it was read."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

from contid.control.engine.events import RunEvent
from contid.control.engine.events.json_form import from_json
from contid.control.engine.tick_layout import LATENESS, TICK, TickRecord
from contid.control.process.ring import (
    CLOSED,
    EVENT_BYTES,
    EVENTS,
    F64,
    LOOKS,
    PART,
    PREPARING,
    ROBOT,
    STAMP,
    TICKS,
    TRIES,
    U64,
    MappedRing,
)


@dataclass(slots=True)
class _Cursor:
    """Number of the next slot to read, and count of slots overwritten before."""

    next: int = 0
    missed: int = 0


class DatedEvent(NamedTuple):
    """An event and the number of ticks that were published before it."""

    ticks: int
    event: RunEvent


class RingReader(MappedRing):
    """A reader with its own position."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._tick = _Cursor()
        self._event = _Cursor()
        self._parts: list[bytes] = []

    @property
    def missed_ticks(self) -> int:
        """Records overwritten before they were read."""
        return self._tick.missed

    @property
    def missed_events(self) -> int:
        """Event slots overwritten before they were read."""
        return self._event.missed

    @property
    def finished(self) -> bool:
        """True when the writer has finished; its records can still be read."""
        return bool(self._numbers[CLOSED])

    def note_look(self) -> None:
        """Count a look of the daemon, which is no other reader, for the control process."""
        self._numbers[LOOKS] += 1

    @property
    def preparing(self) -> bool:
        """True while a request to devices is under way that may take longer than a tick."""
        return bool(self._numbers[PREPARING])

    @property
    def robot(self) -> int:
        """Index of the robot whose tick is under way, -1 for none."""
        return self._numbers[ROBOT] - 1

    @property
    def written(self) -> int:
        """Records written so far."""
        return self._numbers[TICKS]

    @property
    def costs_s(self) -> list[float]:
        """Mean duration of the newest ticks of each robot [s]."""
        return list(self._costs)

    def skip(self) -> int:
        """Go on with the next record and the next event; returns the number of records left out."""
        self._event = _Cursor(self._numbers[EVENTS])
        self._tick = _Cursor(self.written)
        return self._tick.next

    def rewind(self) -> None:
        """Go back to the oldest record in the ring."""
        self._tick = _Cursor(max(self.written - self.slots + 1, 0))

    def ticks(self, at_most: int = 1 << 30) -> list[TickRecord]:
        """Unread records, oldest first."""
        return [self.layout.decode(values) for values in self.raw_ticks(at_most)]

    def raw_ticks(self, at_most: int = 1 << 30) -> list[tuple[float, ...]]:
        """The undecoded values of unread records, oldest first."""
        out: list[tuple[float, ...]] = []
        while len(out) < at_most and (raw := self._next(self._tick, TICKS, self.slots, self._tick_slot)):
            out.append(self._packer.unpack(raw))
        return out

    def newest(self) -> TickRecord | None:
        """The newest record, without moving the position."""
        for _ in range(3):
            number = self.written
            if number == 0:
                return None
            if raw := self._contents(number, self._tick_slot):
                return self.layout.decode(self._packer.unpack(raw))
        return None

    def record_of(self, tick: int) -> TickRecord | None:
        """The record of a tick, or of the first one after it; None before. Does not move the position."""
        found = None
        for number in range(self.written, max(self.written - self.slots + 1, 0), -1):
            raw = self._contents(number, self._tick_slot)
            if raw is None or U64.unpack_from(raw, TICK * U64.size)[0] < tick:
                break
            found = raw
        return None if found is None else self.layout.decode(self._packer.unpack(found))

    def lateness(self, ticks: int) -> list[float]:
        """How late the newest ticks started [s], without moving the position."""
        written = self.written
        newest = range(max(written - min(ticks, self.slots - 1), 0), written)
        at = STAMP.size + LATENESS * F64.size
        return [F64.unpack_from(self._tick_slot(number), at)[0] for number in newest]

    def events(self) -> list[RunEvent]:
        """Unread events, oldest first; an event with overwritten parts is dropped."""
        return [dated.event for dated in self.dated_events()]

    def dated_events(self) -> list[DatedEvent]:
        """As `events`, each with the number of ticks that were published before it."""
        out: list[DatedEvent] = []
        missed = self._event.missed
        while raw := self._next(self._event, EVENTS, self.event_slots, self._event_slot):
            ticks, _, before, after = PART.unpack_from(raw)
            if before == 0 or self._event.missed != missed:
                self._parts.clear()
                missed = self._event.missed
            if before != len(self._parts):
                continue  # rest of an event whose first part was overwritten
            self._parts.append(raw[PART.size :])
            if after == 0:
                out.append(DatedEvent(ticks, from_json(json.loads(b"".join(self._parts)))))
        return out

    def _tick_slot(self, number: int) -> bytes:
        at = self._ticks_at + number % self.slots * self.size
        return self._map[at : at + self.size]

    def _event_slot(self, number: int) -> bytes:
        at = self._events_at + number % self.event_slots * EVENT_BYTES
        length = PART.unpack_from(self._map, at + STAMP.size)[1]
        return self._map[at : at + min(STAMP.size + PART.size + length, EVENT_BYTES)]

    def _contents(self, stamp: int, slot: Callable[[int], bytes]) -> bytes | None:
        """The contents of the slot with a stamp; None when it was overwritten, or is not all visible yet."""
        for _ in range(TRIES):
            raw = slot(stamp - 1)
            found, crc = STAMP.unpack_from(raw)
            contents = raw[STAMP.size :]
            if found != stamp:
                return None
            if crc == crc32(contents, stamp & 0xFFFFFFFF):
                return contents
        return None

    def _next(
        self, cursor: _Cursor, head_place: int, slots: int, slot: Callable[[int], bytes]
    ) -> bytes | None:
        """Copy the next slot; skip and count those that were overwritten or never became whole."""
        while True:
            head = self._numbers[head_place]
            if cursor.next >= head:
                return None
            oldest = head - slots + 1  # the slot after the newest may be being written
            if cursor.next < oldest:
                cursor.missed += oldest - cursor.next
                cursor.next = oldest
            number = cursor.next
            if contents := self._contents(number + 1, slot):
                cursor.next = number + 1
                return contents
            if number + 1 == head:
                return None  # its contents may become visible
            if int(U64.unpack_from(slot(number))[0]) == number + 1:
                cursor.missed += 1
                cursor.next = number + 1
