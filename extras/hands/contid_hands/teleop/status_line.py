"""A line at the bottom of the terminal that is replaced again and again, below a log of lines that stay."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from itertools import groupby
from types import TracebackType
from typing import Self, TextIO


def with_units(values: Sequence[float | None], units: Sequence[str], form: str = ".2f") -> str:
    """Values of axes with the unit after the last of each: ``10.00 12.00 mm 45.00 deg``."""
    shown = ["-" if value is None else f"{value:{form}}" for value in values]
    groups = groupby(zip(shown, units, strict=True), key=lambda pair: pair[1])
    return " ".join(" ".join([*(value for value, _ in group), unit]) for unit, group in groups)


class StatusLine:
    """Writes the line; a context manager that clears it at the end.

    Without a terminal only the lines that stay are written.

    Args:
        out: stream to write to.
    """

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._shown = ""
        self._terminal = out.isatty()

    def log(self, text: str) -> None:
        """Write a text of one or more lines that stays."""
        self._write(f"\r\x1b[K{text}\n{self._shown}" if self._shown else f"{text}\n")

    def show(self, text: str) -> None:
        """Replace the line at the bottom, cut to the width of the terminal."""
        if self._terminal:
            width = shutil.get_terminal_size().columns - 1
            self._shown = text if len(text) <= width else f"{text[: width - 1]}…"
            self._write(f"\r\x1b[K{self._shown}")

    def _write(self, text: str) -> None:
        self._out.write(text)
        self._out.flush()

    def __enter__(self) -> Self:
        """Return itself; the line is cleared on leaving."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        if self._shown:
            self._shown = ""
            self._write("\r\x1b[K")
