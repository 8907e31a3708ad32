"""Keys of a terminal without waiting for Enter; a pipe or file gives its characters as keys."""

from __future__ import annotations

import codecs
import os
import re
import select
import sys
import termios
import tty
from types import TracebackType
from typing import Final, Self

#: Escape sequences of terminals, without ESC; both modes of the cursor keys (xterm, ECMA-48 and DEC).
_SEQUENCES: Final = {
    **{f"{mode}{letter}": name for mode in "[O" for letter, name in zip(
        "ABCDHF", ("up", "down", "right", "left", "home", "end"), strict=True)},
    "[5~": "pageup",
    "[6~": "pagedown",
}  # fmt: skip
_SEQUENCE: Final = re.compile(r"\[[0-9;?]*[ -/]*[@-~]|O[@-~]")
_PARTIAL: Final = re.compile(r"\[[0-9;?]*[ -/]*|O?")
_NAMED: Final = {"\r": "enter", "\n": "enter", "\x7f": "backspace", "\b": "backspace", " ": "space"}
_READ_BYTES: Final = 4096


class KeyDecoder:
    """Bytes of a terminal to keys: characters, and names as ``up``, ``enter``, ``escape``."""

    def __init__(self) -> None:
        self._text = codecs.getincrementaldecoder("utf-8")("replace")
        self._pending = ""

    def feed(self, data: bytes) -> list[str]:
        """Keys of further bytes; without bytes, an escape that nothing followed is a key."""
        text = self._pending + self._text.decode(data)
        self._pending = ""
        keys: list[str] = []
        while text:
            if text[0] != "\x1b":
                keys.append(_NAMED.get(text[0], text[0]))
                text = text[1:]
            elif found := _SEQUENCE.match(text, 1):
                keys.append(_SEQUENCES.get(found.group(), "unknown"))
                text = text[found.end() :]
            elif data and _PARTIAL.fullmatch(text, 1):
                self._pending, text = text, ""
            else:
                keys.append("escape")
                text = text[1:]
        return keys


class Keyboard:
    """Context manager over stdin; restores the settings of the terminal.

    Attributes:
        interactive: stdin is a terminal.
    """

    def __init__(self, descriptor: int | None = None) -> None:
        self._descriptor = sys.stdin.fileno() if descriptor is None else descriptor
        self.interactive = os.isatty(self._descriptor)
        self._decoder = KeyDecoder()
        self._before: list[int | list[bytes | int]] | None = None

    def __enter__(self) -> Self:
        """Keys come without Enter and are not echoed; Ctrl-C still interrupts."""
        if self.interactive:
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        if self._before is not None:
            termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)

    def keys(self, timeout_s: float = 0.0) -> list[str] | None:
        """Keys since the last call; waits at most ``timeout_s`` for one. None at the end of the input."""
        ready, _, _ = select.select([self._descriptor], [], [], timeout_s)
        if not ready:
            return self._decoder.feed(b"")
        try:
            data = os.read(self._descriptor, _READ_BYTES)
        except OSError:  # the terminal is gone
            return None
        return self._decoder.feed(data) if data else None
