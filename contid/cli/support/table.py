"""A group of commands kept in a table, each imported only when it is called; extras add theirs to it."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from functools import cached_property
from importlib import import_module
from typing import Any, TypeAlias

import click

from contid import entry_points

#: Name -> (``module`` or ``module:attribute``, one line of help); the attribute is ``command`` when left out.
Table: TypeAlias = Mapping[str, tuple[str, str]]


class TableGroup(click.Group):
    """The commands of a table, and those that extras offer for the same group; help imports none of them.

    An extra offers a table in the group of entry points ``contid.commands``. Its names have the groups in
    front: ``fleet``, ``calibrate camera``.
    """

    def __init__(
        self,
        table: Table,
        heading: str,
        group: str = "",
        sections: Mapping[str, Sequence[str]] | None = None,
        **options: Any,
    ) -> None:
        """Prepare.

        Args:
            table: the commands.
            heading: of the help.
            group: how the names of the commands that extras add here begin; "" at the top.
            sections: of the help: heading and names, also of extras; None for one with all commands.
            options: of `click.Group`.
        """
        super().__init__(**options)
        self.table = table
        self.heading = heading
        self.sections = sections or {heading: list(table)}
        self._group = f"{group} ".lstrip()

    @cached_property
    def added(self) -> Table:
        """The commands of extras."""
        tables: list[Table] = list(entry_points.load_all(entry_points.COMMANDS).values())
        names = {
            name.removeprefix(self._group): line
            for table in tables
            for name, line in table.items()
            if name.startswith(self._group)
        }
        return {name: line for name, line in names.items() if " " not in name and name not in self.table}

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the table, then those of extras."""
        return [*self.table, *self.added]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the module of one command."""
        line = self.table.get(cmd_name) or self.added.get(cmd_name)
        if line is None:
            return None
        module, _, attribute = line[0].partition(":")
        found: click.Command = getattr(import_module(module), attribute or "command")
        return found

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; an unknown one is refused with the name nearest to it."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            if any(args[0] in names for names in self.sections.values()):
                missing = f"the package of `{ctx.command_path} {args[0]}` is not installed"
                raise click.UsageError(
                    f"{missing}; `pip install --force-reinstall contid` installs it", ctx
                ) from error
            if near := difflib.get_close_matches(args[0], self.list_commands(ctx), n=1):
                raise click.UsageError(f"{error.message} Did you mean {near[0]!r}?", ctx) from error
            raise

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Print the tables."""
        lines = {name: line for name, (_, line) in {**self.table, **self.added}.items()}
        placed = {name for names in self.sections.values() for name in names}
        others = [name for name in self.added if name not in placed]
        for heading, names in {**self.sections, f"{self.heading} of extras": others}.items():
            if found := [(name, lines[name]) for name in names if name in lines]:
                with formatter.section(heading):
                    formatter.write_dl(found)
