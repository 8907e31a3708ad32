"""The writer of a ring: a tick takes one slot, an event as many as its JSON needs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final
from zlib import crc32

from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import EventTooLong
from contid.control.engine.events.json_form import to_json
from contid.control.process.ring import (
    CLOSED,
    EVENT_BYTES,
    EVENT_PARTS,
    EVENTS,
    LOOKS,
    PART,
    PREPARING,
    ROBOT,
    STAMP,
    TICKS,
    U64,
    MappedRing,
)

#: Each duration enters the running mean of its robot with the weight 1 / COSTS, which is the mean of about as
#: many durations.
COSTS: Final = 16.0


class RingWriter(MappedRing):
    """The writer."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._ticks = 0
        self._events = 0
        #: Number of the robot whose model computes, from 1 on; 0 for none.
        self.robot_at_work = self._numbers[ROBOT : ROBOT + 1]

    def close(self) -> None:
        """Unmap and close; idempotent."""
        self.robot_at_work.release()
        super().close()

    def write(self, values: list[float]) -> None:
        """Publish one tick: all values of the layout in order."""
        number = self._ticks
        at = self._ticks_at + number % self.slots * self.size
        self._ticks = number + 1
        self._fill(at, self._ticks, self._packer.pack(*values))
        self._numbers[TICKS] = self._ticks

    def event(self, event: RunEvent) -> None:
        """Publish one event; beyond `EVENT_PARTS` slots its longest text is cut or ``too_long`` sent."""
        body = json.dumps(to_json(event)).encode()
        room = EVENT_BYTES - STAMP.size - PART.size
        if len(body) > room * EVENT_PARTS:
            body = _shortened(to_json(event), room * EVENT_PARTS)
        parts = range(0, len(body), room)
        for index, start in enumerate(parts):
            part = body[start : start + room]
            at = self._events_at + self._events % self.event_slots * EVENT_BYTES
            self._events += 1
            head = PART.pack(self._ticks, len(part), index, len(parts) - 1 - index)
            self._fill(at, self._events, head + part)
            self._numbers[EVENTS] = self._events

    def _fill(self, at: int, number: int, contents: bytes) -> None:
        """Fill a slot; its number comes last.

        While it has the number 0, readers take it for overwritten. A copy that was made meanwhile fails the
        CRC, which is that of the contents and the number (`contid.control.process.ring`).
        """
        STAMP.pack_into(self._map, at, 0, crc32(contents, number & 0xFFFFFFFF))
        self._map[at + STAMP.size : at + STAMP.size + len(contents)] = contents
        U64.pack_into(self._map, at, number)

    @property
    def looks(self) -> int:
        """How often the daemon has looked at the ring."""
        return self._numbers[LOOKS]

    def mark_preparing(self, begins: bool) -> None:
        """Mark that a request to devices begins, which may take longer than a tick, or is over."""
        self._numbers[PREPARING] = begins

    def publish_costs(self, robots_s: Sequence[float]) -> None:
        """Publish durations of a tick of every robot [s]; readers get their running means."""
        for index, took_s in enumerate(robots_s):
            self._costs[index] += (took_s - self._costs[index]) / COSTS

    def finish(self) -> None:
        """Mark the ring as complete."""
        self._numbers[CLOSED] = 1


def _shortened(event: Mapping[str, Any], limit: int) -> bytes:
    """The JSON of an event within ``limit`` bytes: its longest text cut, or the event ``too_long``."""
    texts = {key: value for key, value in event.items() if isinstance(value, str) and key != "event"}
    longest = max(texts, key=lambda key: len(texts[key]), default=None)
    if longest is not None:
        # A character takes at most twelve bytes, as two escapes.
        others = len(json.dumps({**event, longest: "..."}))
        kept = texts[longest][: max(limit - others, 0) // 12] + "..."
        body = json.dumps({**event, longest: kept}).encode()
        if len(body) <= limit:
            return body
    return json.dumps(to_json(EventTooLong(kind=event["event"]))).encode()
