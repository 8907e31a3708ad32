"""Type of options that name a figure to write; its ending is checked before any work."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

if TYPE_CHECKING:
    _Path = click.Path[Path]
else:  # older releases of click have no type of its value
    _Path = click.Path

_KINDS: Final = (".png", ".svg", ".pdf")


class FigurePath(_Path):
    """The path of a figure to write."""

    def __init__(self) -> None:
        super().__init__(dir_okay=False, path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """The path; an unknown ending is a usage error."""
        path = Path(super().convert(value, param, ctx))
        if path.suffix.lower() not in _KINDS:
            self.fail(f"{str(path)!r} must end in {', '.join(_KINDS)}.", param, ctx)
        return path


FIGURE: Final = FigurePath()
