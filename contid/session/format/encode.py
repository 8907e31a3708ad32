"""Records to messages: one template per channel, filled in one step.

Floats have the fewest digits that read back to the same float64, so nothing is lost between a tick and its
replay. JSON has neither NaN nor infinity, and readers do not agree on ``1e999`` (Python and JavaScript read
infinity, orjson, RapidJSON, Go and Rust refuse the message): a NaN has no key, and neither has an infinite
number. The key `INFINITE` lists the paths of the infinite ones, keys joined by slashes, with a minus in front
of negative ones: ``"infinite": ["robots/left/s1_p1/age_s", "-robots/left/s1_p1/effort"]``. A vector is
recorded as a whole or not at all: one whose components are not all finite has no key, and all three read back
as NaN.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from operator import itemgetter
from typing import Any, Final, NamedTuple

from contid.control.engine.tick_layout import RecordLayout
from contid.session.format.channels import INFINITE, TICK_CHANNELS, Field, fields

#: Number of patterns of absent values whose texts are kept; a run has a few, one per state of its robots.
_PATTERNS: Final = 256
_Pick = Callable[[Sequence[str]], tuple[str, ...]]


class _Template(NamedTuple):
    """A message with ``%s`` in the place of every number.

    Attributes:
        text: the message.
        pick: takes the texts of the whole record, returns those of its places in their order.
    """

    text: str
    pick: _Pick


@dataclass(frozen=True, slots=True)
class _Form:
    """How to write records in which the same values are finite, channel by channel as in `TICK_CHANNELS`.

    Attributes:
        templates: templates of the messages.
        absent_numbers: fields with one number, no vector, that have no key because the number is not finite.
    """

    templates: list[_Template]
    absent_numbers: list[list[Field]]


class Encoder:
    """Turns records of one layout into messages."""

    def __init__(self, layout: RecordLayout, device_units: Mapping[str, str]) -> None:
        self._fields = [list(fields(layout, device_units, channel)) for channel in TICK_CHANNELS]
        all_fields = [field for channel_fields in self._fields for field in channel_fields]
        self._flags = [field.slots[0] for field in all_fields if field.kind == "boolean"]
        self._integers = [field.slots[0] for field in all_fields if field.kind == "integer"]
        self._forms: dict[bytes, _Form] = {}

    def encode(self, values: Sequence[float]) -> list[bytes]:
        """Encode a record as one message for each channel of `TICK_CHANNELS`."""
        pattern = bytes(map(isfinite, values))
        form = self._forms.get(pattern) or self._form(pattern)
        texts = list(map(repr, values))
        for slot in self._flags:
            texts[slot] = "true" if values[slot] else "false"
        for slot in self._integers:
            texts[slot] = str(int(values[slot]))
        messages = [(text % pick(texts)).encode() for text, pick in form.templates]
        if inf in values or -inf in values:
            messages = [
                _with_infinite(message, absent, values)
                for message, absent in zip(messages, form.absent_numbers, strict=True)
            ]
        return messages

    def _form(self, finite: bytes) -> _Form:
        """The form of records whose values are finite where the pattern has 1; kept in a bounded cache."""
        if len(self._forms) >= _PATTERNS:
            self._forms.clear()
        form = _Form([], [])
        for channel_fields in self._fields:
            present: list[Field] = []
            absent: list[Field] = []
            for field in channel_fields:
                finite_field = field.required or all(finite[slot] for slot in field.slots)
                (present if finite_field else absent).append(field)
            form.templates.append(_template(channel_fields, present))
            form.absent_numbers.append([field for field in absent if field.kind == "number"])
        self._forms[finite] = form
        return form


def _template(channel_fields: Sequence[Field], present: Sequence[Field]) -> _Template:
    """The template of a channel: the objects of all its fields, with the values of those that are present."""
    root: dict[str, Any] = {}
    for field in channel_fields:
        parent = root
        for key in field.path[:-1]:
            parent = parent.setdefault(key, {})
        if field in present:
            marks = [f"@{slot}@" for slot in field.slots]
            parent[field.path[-1]] = marks if field.kind == "array" else marks[0]
    text = json.dumps(root, separators=(",", ":")).replace("%", "%%")
    slots = [int(slot) for slot in re.findall(r'"@(\d+)@"', text)]
    pick: _Pick = itemgetter(*slots) if len(slots) > 1 else lambda texts: (texts[slots[0]],)
    return _Template(re.sub(r'"@\d+@"', "%s", text), pick)


def _with_infinite(message: bytes, absent: Sequence[Field], values: Sequence[float]) -> bytes:
    """The message with the paths of the numbers that are absent because they are infinite, not NaN."""
    paths = [
        ("-" if values[field.slots[0]] < 0 else "") + "/".join(field.path)
        for field in absent
        if values[field.slots[0]] in (inf, -inf)
    ]
    if not paths:
        return message
    return message[:-1] + f",{json.dumps(INFINITE)}:{json.dumps(paths)}}}".encode()
