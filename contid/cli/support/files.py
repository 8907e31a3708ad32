"""Types of options and arguments that are files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Final

import click

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
    """A figure to write; its ending is checked before any work."""

    def convert(
        self, value: str | os.PathLike[str], param: click.Parameter | None, ctx: click.Context | None
    ) -> Any:
        """The path; an unknown ending is a usage error."""
        path = super().convert(value, param, ctx)
        if path.suffix.lower() not in _FIGURES:
            self.fail(f"{str(path)!r} must end in {', '.join(_FIGURES)}.", param, ctx)
        return path


FIGURE: Final = NewFigure(dir_okay=False, path_type=Path)
#: A robot file that is changed.
CHANGED_FILE: Final = click.Path(exists=True, dir_okay=False, path_type=Path)
#: Rows that a client sends; what is not UTF-8 is refused with the name of its column.
ROWS_FILE: Final = click.File(encoding="utf-8", errors="replace")
#: A recording that is read.
SESSION: Final = click.argument("session_file", type=click.Path(exists=True, dir_okay=False))
