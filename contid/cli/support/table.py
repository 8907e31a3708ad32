"""A group of commands kept in a table, each imported only when it is called."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

import click


class TableGroup(click.Group):
    """``table``: name -> (``module`` or ``module:attribute``, one line of help).

    The attribute is ``command`` when left out. Help imports no command.
    """

    def __init__(self, table: Mapping[str, tuple[str, str]], heading: str, **options: Any) -> None:
        super().__init__(**options)
        self.table = table
        self.heading = heading

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the table."""
        return list(self.table)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the module of one command."""
        if cmd_name not in self.table:
            return None
        module, _, attribute = self.table[cmd_name][0].partition(":")
        found: click.Command = getattr(import_module(module), attribute or "command")
        return found

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Print the table."""
        with formatter.section(self.heading):
            formatter.write_dl([(name, line) for name, (_, line) in self.table.items()])
