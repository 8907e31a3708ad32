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
        known = self.list_commands(ctx)
        if args and args[0] not in (*known, *self.get_help_option_names(ctx)):
            # A name near that of a tracker is a slip, where no option shows that a robot is meant.
            near = [] if _has_camera_option(args) else difflib.get_close_matches(args[0], known, n=1)
            if near:
                raise click.UsageError(f"No such command {args[0]!r}. Did you mean {near[0]!r}?", ctx)
            args = [_DEFAULT, *args]
        return super().parse_args(ctx, args)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of a tracker; a word that names none is a robot, which the camera looks at."""
        return super().get_command(ctx, cmd_name) or super().get_command(ctx, _DEFAULT)


def _has_camera_option(args: list[str]) -> bool:
    """True of arguments with an option of the camera, as ``--camera 0`` or ``--camera=0``."""
    return any(each.partition("=")[0] in ("--camera", "--tags") for each in args)


command = TrackGroup(
    {},
    "Trackers",
    group="track",
    name="track",
    help="Measure the tips of robots and send them to the running daemon.\n\n"
    "`contid track ROBOT --camera 0` is short for `contid track camera ROBOT --camera 0`.",
)
