"""The options that this extra adds: ``--view`` of `contid run`, ``--rrd`` and ``--foxglove`` of an export."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from contid.cli.support.added_options import Watch
from contid.cli.support.parameters import NewFile

if TYPE_CHECKING:
    from contid.robot_file.load import LoadedFile
    from contid.session.read import Session
    from contid_dynamics.swing import SwingingPose
    from contid_view.view_target import ViewTarget


class ViewOption:
    """A viewer of the run; see `contid.cli.support.added_options.RunOption`."""

    options = (
        click.Option(
            ["--view"],
            metavar="spawn|serve|FILE.rrd",
            help="Show the robots: in a window, in a browser on this machine, or in a file for "
            "`contid view`.",
        ),
    )

    def prepare(self, values: Mapping[str, Any], virtual: bool) -> Watch | None:
        """The viewer as an observer; without it when only a display is missing."""
        target = None if values.get("view") is None else _view_target(values["view"])
        if target is None:
            return None
        from contid_view.observer import ViewerObserver

        observer = ViewerObserver(target)
        return Watch(observer=observer, lost=lambda: "the file of --view" if observer.lost else "")


def _view_target(text: str) -> ViewTarget | None:
    """The target of --view, refused before the run starts; None if only a display is missing."""
    from contid_view.view_target import NoDisplayError, check, parse_view_target

    target = parse_view_target(text)
    try:
        check(target)
    except NoDisplayError as error:
        click.echo(f"contid: view: {error}; the run continues without a view", err=True)
        return None
    return target


class RrdExport:
    """For the Rerun viewer; see `contid_sessions.export_command.ExportOption`."""

    options = (
        click.Option(["--rrd"], type=NewFile(dir_okay=False), help="A recording for the Rerun viewer."),
    )

    def write(self, session: Session, loaded: LoadedFile, path: Path) -> None:
        """Draw the session into a file."""
        os.environ.setdefault("RUST_LOG", "off")  # contid reports errors itself
        from contid_view.export import draw
        from contid_view.view_target import Kind, ViewTarget
        from contid_view.whole_drawing import whole_drawing

        entries = ((entry.values, entry.event) for entry in session.entries())
        with whole_drawing(path) as part:
            draw(entries, loaded, session.layout, ViewTarget(Kind.FILE, part))


class FoxgloveExport:
    """For Foxglove; see `contid_sessions.export_command.ExportOption`."""

    options = (
        click.Option(
            ["--foxglove"],
            type=NewFile(dir_okay=False),
            help="MCAP with bodies, frames and joint states for Foxglove's panels.",
        ),
    )

    def write(self, session: Session, loaded: LoadedFile, path: Path) -> None:
        """Write its messages into an MCAP file."""
        from contid.whole_file import replacing
        from contid_view.foxglove_export import write_foxglove

        with replacing(path) as file:
            entries = ((entry.time_ns, entry.values, entry.event) for entry in session.entries())
            write_foxglove(file, entries, loaded, session.layout)


class SwingsExport:
    """Modes that swing, for the Rerun viewer; an object of the group ``contid.modes``."""

    options = (
        click.Option(
            ["--save"],
            type=NewFile(dir_okay=False),
            metavar="FILE.rrd",
            help="The modes, swinging side by side, for `contid view`.",
        ),
    )

    def write(self, loaded: LoadedFile, swinging: Mapping[str, SwingingPose], path: Path) -> None:
        """Draw the modes of robots into a file."""
        os.environ.setdefault("RUST_LOG", "off")  # contid reports errors itself
        from contid_view.rerun.swings import draw_swings
        from contid_view.whole_drawing import whole_drawing

        with whole_drawing(path) as part:
            draw_swings(loaded, swinging, part)


VIEW: Final = ViewOption()
RRD: Final = RrdExport()
FOXGLOVE: Final = FoxgloveExport()
SWINGS: Final = SwingsExport()
