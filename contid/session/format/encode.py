"""Records to messages: one template per channel, filled in one step.

Floats have the fewest digits that read back to the same float64, so nothing is lost between a tick and its
replay. JSON has neither NaN nor infinity, and readers do not agree on ``1e999`` (Python and JavaScript read
infinity, orjson, RapidJSON, Go and Rust refuse the message): a NaN has no key, and neither has an infinite
number, which `INFINITE` names instead.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from operator import itemgetter
from typing import Any, Final

from contid.control.engine.tick_layout import RecordLayout
from contid.session.format.channels import INFINITE, TICK_CHANNELS, Field, fields

#: Number of patterns of absent values whose texts are kept; a run has a few, one per state of its robots.
_PATTERNS: Final = 256
_Pick = Callable[[Sequence[str]], tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class _Form:
    """The texts of all channels for records with the same values absent.

    Attributes:
        texts: of each channel, and what picks the numbers for its places.
        absent: fields of each channel with one number that is not there.
    """

    texts: list[tuple[str, _Pick]]
    absent: list[list[Field]]


class Encoder:
    """Turns records of one layout into messages."""

    def __init__(self, layout: RecordLayout, device_units: Mapping[str, str]) -> None:
        self._fields = [list(fields(layout, device_units, channel)) for channel in TICK_CHANNELS]
        known = [each for some in self._fields for each in some]
        self._flags = [each.slots[0] for each in known if each.kind == "boolean"]
        self._integers = [each.slots[0] for each in known if each.kind == "integer"]
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
        messages = [(text % pick(texts)).encode() for text, pick in form.texts]
        if inf in values or -inf in values:
            messages = [_with_infinite(*each, values) for each in zip(messages, form.absent, strict=True)]
        return messages

    def _form(self, finite: bytes) -> _Form:
        if len(self._forms) >= _PATTERNS:
            self._forms.clear()
        form = _Form([], [])
        for some in self._fields:
            there = [each.required or all(finite[slot] for slot in each.slots) for each in some]
            form.texts.append(_template(some, there))
            form.absent.append(
                [each for each, yes in zip(some, there, strict=True) if not yes and each.kind == "number"]
            )
        self._forms[finite] = form
        return form


def _template(some: Sequence[Field], there: Sequence[bool]) -> tuple[str, _Pick]:
    """A message with ``%s`` in the place of every number, and what picks the numbers."""
    root: dict[str, Any] = {}
    for each, yes in zip(some, there, strict=True):
        at = root
        for key in each.path[:-1]:
            at = at.setdefault(key, {})
        if yes:
            marks = [f"@{slot}@" for slot in each.slots]
            at[each.path[-1]] = marks if each.kind == "array" else marks[0]
    text = json.dumps(root, separators=(",", ":")).replace("%", "%%")
    slots = [int(slot) for slot in re.findall(r'"@(\d+)@"', text)]
    pick: _Pick = itemgetter(*slots) if len(slots) > 1 else lambda texts: (texts[slots[0]],)
    return re.sub(r'"@\d+@"', "%s", text), pick


def _with_infinite(message: bytes, absent: Sequence[Field], values: Sequence[float]) -> bytes:
    """The message with the names of numbers that are absent because they are infinite."""
    paths = [
        ("-" if values[each.slots[0]] < 0 else "") + "/".join(each.path)
        for each in absent
        if values[each.slots[0]] in (inf, -inf)
    ]
    if not paths:
        return message
    return message[:-1] + f",{json.dumps(INFINITE)}:{json.dumps(paths)}}}".encode()
