"""Types of options that are files."""

from __future__ import annotations

import os
from typing import Any

import click


class NewFile(click.Path):
    """An output file; ``-`` is refused because it would become a file of that name."""

    def convert(
        self, value: str | os.PathLike[str], param: click.Parameter | None, ctx: click.Context | None
    ) -> Any:
        """The name as it was given."""
        if value in ("", "-"):
            self.fail(f"{value!r} names no file; give a name, standard output is not written to", param, ctx)
        return super().convert(value, param, ctx)


#: A recording that is read.
SESSION = click.argument("session_file", type=click.Path(exists=True, dir_okay=False))
