"""A group of commands kept in a table, each imported only when it is called."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module

import click


class TableGroup(click.Group):
    """``table``: name -> (module that defines it as ``command``, one line of help)."""

    def __init__(self, table: Mapping[str, tuple[str, str]], heading: str, help: str) -> None:
        super().__init__(help=help)
        self.table = table
        self.heading = heading

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the table."""
        return list(self.table)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the module of one command."""
        if cmd_name not in self.table:
            return None
        found: click.Command = import_module(self.table[cmd_name][0]).command
        return found

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The table itself is the help."""
        with formatter.section(self.heading):
            formatter.write_dl([(name, line) for name, (_, line) in self.table.items()])
