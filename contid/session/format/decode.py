"""Messages back to records, bit for bit: gathered as they come, put in order once per tick.

What a message does not have is NaN in its record, so that files of every revision are read alike: revision 0
has fewer keys, and ``null`` in revisions 0 and 1 is absent as well.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from math import inf, nan
from operator import itemgetter
from typing import Any, Final, NamedTuple

from contid.control.engine.tick_layout import DEADLINE, SKIPPED, TICK, RecordLayout
from contid.session.format.channels import INFINITE, TICK_CHANNELS, Field, fields

#: More ticks, and more seconds, than any run has.
MAX_COUNT: Final = 1 << 53
_NO_VECTOR: Final = (nan, nan, nan)


class _Group(NamedTuple):
    """Values of one object of a message: first its numbers, then its vectors.

    Attributes:
        path: keys from the message down to the object.
        absent: NaN by the key of every number that may be absent.
        numbers: picks the numbers, None when there are only vectors.
        vectors: keys.
        slots: places in the record, in that order.
    """

    path: tuple[str, ...]
    absent: dict[str, float]
    numbers: Callable[[Any], tuple[Any, ...]] | None
    vectors: tuple[str, ...]
    slots: tuple[int, ...]


class Decoder:
    """Turns messages of one layout into records."""

    def __init__(self, layout: RecordLayout, device_units: Mapping[str, str]) -> None:
        self._groups: dict[str, list[_Group]] = {}
        order: dict[int, int] = {}
        self._size = 0
        for channel in TICK_CHANNELS:
            by_path: dict[tuple[str, ...], list[Field]] = {}
            for field in fields(layout, device_units, channel):
                by_path.setdefault(field.path[:-1], []).append(field)
            self._groups[channel] = [_group(path, group_fields) for path, group_fields in by_path.items()]
            for group in self._groups[channel]:
                order |= {slot: self._size + place for place, slot in enumerate(group.slots)}
                self._size += len(group.slots)
        self._arrange = itemgetter(*(order[slot] for slot in sorted(order)))
        self._check = layout.packer().pack
        self._decode = json.JSONDecoder().decode

    def gather(self, gathered: list[Any], channel: str, data: bytes) -> None:
        """Add what a message holds; the messages of a tick in the order of `TICK_CHANNELS`.

        Raises:
            ValueError, KeyError, TypeError, AttributeError: it is not a message of this channel.
        """
        message = self._decode(data.decode())
        if INFINITE in message:
            _put_infinite(message)
        for path, absent, numbers, vectors, _ in self._groups[channel]:
            part = message
            for key in path:
                part = part[key]
            if numbers is not None:
                gathered += numbers(absent | part if absent else part)
            for key in vectors:
                gathered += part.get(key) or _NO_VECTOR

    def record(self, gathered: Sequence[Any]) -> list[float]:
        """The record of the gathered messages.

        Raises:
            ValueError: a message is missing, a vector has not three numbers, or the tick has no time.
            struct.error, OverflowError: one is no number that a record can hold.
        """
        if len(gathered) != self._size:
            raise ValueError(f"{len(gathered)} values, where a tick has {self._size}")
        values = list(self._arrange(gathered))
        if None in values:
            values = [nan if value is None else value for value in values]
        self._check(*values)  # cheaper than looking at each: only numbers can be packed
        tick, skipped, deadline_s = values[TICK], values[SKIPPED], values[DEADLINE]
        if not (
            0.0 <= tick < MAX_COUNT and 0.0 <= skipped < MAX_COUNT and -MAX_COUNT < deadline_s < MAX_COUNT
        ):
            raise ValueError(f"tick {tick}, skipped {skipped}, deadline {deadline_s} s are no place in a run")
        return values


def _group(path: tuple[str, ...], some: Sequence[Field]) -> _Group:
    numbers = [field for field in some if field.kind != "array"]
    vectors = [field for field in some if field.kind == "array"]
    slots = tuple(slot for field in (*numbers, *vectors) for slot in field.slots)
    absent = {field.path[-1]: nan for field in numbers if not field.required}
    keys = [field.path[-1] for field in numbers]
    pick: Callable[[Any], tuple[Any, ...]] | None = None
    if keys:
        pick = itemgetter(*keys) if len(keys) > 1 else lambda part: (part[keys[0]],)
    return _Group(path, absent, pick, tuple(field.path[-1] for field in vectors), slots)


def _put_infinite(message: dict[str, Any]) -> None:
    """Write the infinite numbers that a message names into it."""
    for path in message[INFINITE]:
        part = message
        *way, last = path.removeprefix("-").split("/")
        for key in way:
            part = part[key]
        part[last] = -inf if path.startswith("-") else inf
