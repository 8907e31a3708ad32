"""``contid track``: trackers by kind; without one of their names the arguments are those of the camera."""

from __future__ import annotations

import difflib
from typing import Final

import click

from contid.cli.support.table import TableGroup

_DEFAULT: Final = "camera"


class TrackGroup(TableGroup):
    """Trackers that extras add as ``track NAME``."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Insert ``camera`` before arguments that name no tracker."""
        if args and args[0] not in (*self.list_commands(ctx), *self.get_help_option_names(ctx)):
            near = difflib.get_close_matches(args[0], self.list_commands(ctx), n=1)
            if near and "--camera" not in args and "--tags" not in args:
                raise click.UsageError(f"No such command {args[0]!r}. Did you mean {near[0]!r}?", ctx)
            args = [_DEFAULT, *args]
        return super().parse_args(ctx, args)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of a tracker; a word that names none is a robot, which the camera looks at."""
        return super().get_command(ctx, cmd_name) or super().get_command(ctx, _DEFAULT)


command = TrackGroup(
    {},
    "Trackers",
    group="track",
    name="track",
    help="Measure the tips of robots and send them to the running daemon.\n\n"
    "`contid track ROBOT --camera 0` is short for `contid track camera ROBOT --camera 0`.",
)
