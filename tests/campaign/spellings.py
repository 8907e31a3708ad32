"""Random spellings of an emergency stop, and random requests that are none, from a seed.

What contains a verb that a person reads as an emergency stop must stop: whatever its case, separators,
white space, escapes, quotes, encoding, other fields, order of fields, and where the line is cut off behind
it. What has another verb must not, also with the same texts in its other fields.
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable
from typing import Any, Final

WHITE: Final = ("", "", "", " ", "\t", "  ", " \t ", "\r")
SEPARATORS: Final = ("", "", "-", "_", " ", ".", ". ")
OTHER_VERBS: Final = ("status", "hello", "move", "stop", "hold", "ping", "acquire", "rows", "step", "estops")
#: Texts that a stop would have, as values and names of other fields.
TEXTS: Final = ("estop", "emergency stop", '"verb":"estop"', "verb", "x", "\u202e", "\x00", "é", "")


class Spellings:
    """Lines without their line feed, drawn with given dice."""

    def __init__(self, dice: random.Random) -> None:
        self._dice = dice

    def estop(self) -> bytes:
        """A line that orders an emergency stop."""
        dice = self._dice
        if dice.random() < 0.1:
            return self._bare()
        quote = '"' if dice.random() < 0.85 else "'"
        verb = self._pair(quote, self._cased("verb"), f"{quote}{self._word(quote)}{quote}")
        fields = [self._field() for _ in range(dice.choice((0, 1, 1, 2, 5)))] if quote == '"' else []
        if dice.random() < 0.1 and quote == '"':
            fields.append(self._pair('"', "verb", json.dumps(dice.choice(OTHER_VERBS))))
        fields.insert(at := dice.randint(0, len(fields)), verb)
        cut = dice.random() < 0.1
        text = self._object(fields[: at + 1] if cut else fields, cut)
        return self._encoded(text)

    def other(self) -> bytes:
        """A well-formed request with another verb."""
        fields = [self._field(decoys=True) for _ in range(self._dice.randint(0, 4))]
        fields = [each for each in fields if "NaN" not in each and "Infinity" not in each]
        fields.insert(
            self._dice.randint(0, len(fields)),
            self._pair('"', "verb", json.dumps(self._dice.choice(OTHER_VERBS))),
        )
        return ("{" + ",".join(fields) + "}").encode()

    def _bare(self) -> bytes:
        word = self._word("")
        form: Callable[[str], str] = self._dice.choice(
            (str, lambda w: f'["{w}"]', lambda w: f'"{w}"', lambda w: f"{w}!", lambda w: f'{{"{w}"}}')
        )
        return self._encoded(self._white() + form(word) + self._white())

    def _word(self, quote: str) -> str:
        head = self._dice.choice(("e", "e", "emergency"))
        word = self._cased(head) + self._dice.choice(SEPARATORS) + self._cased("stop")
        if quote == '"' and self._dice.random() < 0.2:
            word = "".join(f"\\u{ord(each):04x}" if self._dice.random() < 0.3 else each for each in word)
        return f"{self._inner()}{word}{self._inner()}" if quote else word

    def _cased(self, text: str) -> str:
        kind = self._dice.randrange(6)
        if kind < 3:
            return text
        return (
            text.upper(),
            text.capitalize(),
            "".join(self._dice.choice((each, each.upper())) for each in text),
        )[kind - 3]

    def _object(self, fields: list[str], cut: bool) -> str:
        text = "{" + ",".join(self._white() + each + self._white() for each in fields)
        if cut:
            return text + self._dice.choice(("", ",", ', "ro', ', "id": '))
        text += "}"
        return self._white() + (f"[{text}]" if self._dice.random() < 0.03 else text) + self._white()

    def _pair(self, quote: str, key: str, value: str) -> str:
        return f"{quote}{key}{quote}{self._white()}:{self._white()}{value}"

    def _field(self, decoys: bool = False) -> str:
        names = ("id", "robots", "rate", "name", "protocol", "why")
        name = self._dice.choice(names)
        if decoys and self._dice.random() < 0.3:
            name = self._dice.choice(("estop", "x verb", "e-stop"))
        return self._pair('"', name, json.dumps(self._value(3), ensure_ascii=self._dice.random() < 0.5))

    def _value(self, depth: int) -> Any:
        dice = self._dice
        kind = dice.randrange(11 if depth else 8)
        match kind:
            case 0:
                return None
            case 1:
                return dice.random() < 0.5
            case 2:
                return dice.choice((0, -1, 7.0, 1e308, 2**70, math.nan, math.inf, -math.inf))
            case 3:
                return dice.randint(-1000, 1000)
            case 4:
                return "x" * dice.choice((1, 201, 5000))
            case 5 | 6:
                return dice.choice(TEXTS)
            case 7:
                return "".join(
                    chr(dice.choice((34, 39, 92, 47, 58, 123, 233, 0x4E00, 0x1F6D1))) for _ in range(6)
                )
            case 8:
                return [self._value(depth - 1) for _ in range(dice.randint(0, 3))]
            case 9:
                return {dice.choice(("a", "id", "estop")): self._value(depth - 1) for _ in range(2)}
        deep: Any = 0
        for _ in range(dice.choice((3, 30))):
            deep = [deep]
        return deep

    def _white(self) -> str:
        return self._dice.choice(WHITE)

    def _inner(self) -> str:
        return self._dice.choice(("", "", "", " ", "  "))

    def _encoded(self, text: str) -> bytes:
        kind = self._dice.randrange(20)
        if kind < 3:
            return text.encode(("utf-16-le", "utf-16-be", "utf-32-le")[kind])
        data = text.encode()
        if kind == 3:
            return b"\xef\xbb\xbf" + data
        if kind == 4:  # bytes that are no UTF-8, inside the line
            return data.replace(b"x", b"\xff", 1)
        return data
