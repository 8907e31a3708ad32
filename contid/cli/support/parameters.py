"""Types of options and arguments: files, robot files by name, and numbers.

Numbers refuse ``nan`` and ``inf``, unlike click's own.
"""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
from click.types import FloatParamType

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    _Tuple = click.ParamType[tuple[float, ...]]
else:  # older releases of click have no type of its value
    _Tuple = click.ParamType

_FIGURES: Final = (".png", ".svg", ".pdf")


class NewFile(click.Path):
    """An output file; ``-`` is refused because it would become a file of that name."""

    def convert(
        self, value: str | os.PathLike[str], param: click.Parameter | None, ctx: click.Context | None
    ) -> Any:
        """The name as it was given."""
        if value in ("", "-"):
            self.fail(f"{value!r} names no file; give a name, standard output is not written to", param, ctx)
        return super().convert(value, param, ctx)


class NewFigure(NewFile):
    """A figure to write; its ending and its folder are checked before any work."""

    def convert(
        self, value: str | os.PathLike[str], param: click.Parameter | None, ctx: click.Context | None
    ) -> Any:
        """The path; an unknown ending and a missing folder are usage errors."""
        path = super().convert(value, param, ctx)
        if path.suffix.lower() not in _FIGURES:
            self.fail(f"{str(path)!r} must end in {', '.join(_FIGURES)}.", param, ctx)
        if not path.parent.is_dir():
            self.fail(f"{str(path)!r}: there is no folder {str(path.parent)!r}.", param, ctx)
        return path


FIGURE: Final = NewFigure(dir_okay=False, path_type=Path)
#: A robot file that is changed.
CHANGED_FILE: Final = click.Path(exists=True, dir_okay=False, path_type=Path)
#: Rows that a client sends; what is not UTF-8 is refused with the name of its column.
ROWS_FILE: Final = click.File(encoding="utf-8", errors="replace")
#: A recording that is read.
SESSION: Final = click.argument("session_file", type=click.Path(exists=True, dir_okay=False))


def robot_names(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Shipped names with this beginning; the shell adds the files."""
    from click.shell_completion import CompletionItem

    from contid.robot_file.load import configs_folder

    names = sorted(file.stem for file in configs_folder().glob("*.yaml"))
    shipped = [CompletionItem(name) for name in names if name.startswith(incomplete)]
    return [*shipped, CompletionItem(incomplete, type="file")]


class Number(FloatParamType):
    """A finite number."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number; anything but a finite number is a usage error."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number


class NumberRange(click.FloatRange, Number):
    """A finite number in a range."""

    name = "number"


class Numbers(_Tuple):
    """From ``min_count`` to ``max_count`` numbers separated by commas: ``50,70``."""

    name = "numbers"

    def __init__(self, min_count: int, max_count: int, each: FloatParamType) -> None:
        self.min_count, self.max_count, self.each = min_count, max_count, each

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """The numbers; a wrong count, or a number that ``each`` refuses, is a usage error."""
        if isinstance(value, tuple):
            return value
        parts = value.split(",")
        if not self.min_count <= len(parts) <= self.max_count:
            several = self.min_count < self.max_count
            count = f"{self.min_count} to {self.max_count}" if several else f"{self.min_count}"
            self.fail(f"{value!r} is not {count} numbers with commas between.", param, ctx)
        return tuple(self.each.convert(part, param, ctx) for part in parts)


NUMBER: Final = Number()
POSITIVE: Final = NumberRange(min=0, min_open=True)
