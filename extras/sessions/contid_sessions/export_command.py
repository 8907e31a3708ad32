"""``contid session export|lerobot|merge``: recordings in the formats of other programs, and on one clock."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import click

from contid import entry_points
from contid.cli.support.added_options import ExtendedCommand
from contid.cli.support.parameters import SESSION, NewFile
from contid.cli.support.streams import counting

if TYPE_CHECKING:
    from contid.robot_file.load import LoadedFile
    from contid.session.read import Session


class ExportOption(Protocol):
    """An option of `contid session export`: an object of the group ``contid.exports``, of the same name."""

    options: Sequence[click.Option]

    def write(self, session: Session, loaded: LoadedFile, path: Path) -> None:
        """Write a session in the format of another program, with the robots of a robot file."""
        ...


Command = TypeVar("Command", bound=Callable[..., Any])


def _output(name: str, what: str) -> Callable[[Command], Command]:
    return click.option(f"--{name}", type=NewFile(dir_okay=name == "csv"), help=what)


@click.command(cls=ExtendedCommand, group=entry_points.EXPORTS)
@SESSION
@_output("csv", "FILE.csv: one table; else a folder of channels.")
@_output("parquet", "One table, typed.")
@_output("hdf5", "A group per channel, and the events.")
@_output("yaml", "The robot file it was recorded with.")
@click.option("--robot", help="Robot file for the shapes of a viewer instead of the recorded one.")
def export(session_file: str, robot: str | None, **outputs: str | None) -> None:
    """Write SESSION_FILE in the formats of other programs.

    Tables are in mm and bar: all channels, and axes and tip by forward kinematics of the measurements.
    """
    from contid.session.read import Session
    from contid_sessions import csv_files

    paths = {name: Path(path) for name, path in outputs.items() if path is not None}
    if not paths:
        raise click.UsageError(
            f"give an output: --csv FOLDER, --csv FILE.csv, or a file for --{', --'.join([*outputs][1:])}"
        )
    _refuse_shared(paths)
    drawn = [name for name in paths if name in export.added]
    if robot is not None and not drawn:
        raise click.UsageError(f"--robot is for the shapes of a viewer: for --{', --'.join(export.added)}")
    with counting("ticks read") as count:
        session = Session(Path(session_file), count)
        for path in paths.values():
            _refuse_recording(path)
        # Before anything is written: it may be another robot.
        loaded = file_to_draw(session, robot) if drawn else None
        written: list[Path] = []
        for name, path in paths.items():
            if name == "yaml":
                csv_files.export_robot_file(session, path)
            elif name == "csv":
                export_csv = csv_files.export_joined if path.suffix == ".csv" else csv_files.export_channels
                written += export_csv(session, path)
                continue
            elif name == "parquet":
                from contid_sessions.typed_tables import export_parquet

                export_parquet(session, path)
            elif name == "hdf5":
                from contid_sessions.typed_tables import export_hdf5

                export_hdf5(session, path)
            elif loaded is not None:
                added: ExportOption = export.added[name]
                added.write(session, loaded, path)
            written.append(path)
    click.echo("\n".join(map(str, written)))
    _note_cut(session)


def _refuse_shared(paths: Mapping[str, Path]) -> None:
    """Refuse two outputs in one file: the second would replace the first."""
    names: dict[str, str] = {}
    for name, path in paths.items():
        other = names.setdefault(os.path.realpath(path), name)
        if other != name:
            raise click.UsageError(f"--{other} and --{name} name the same file: {path}")


@click.command()
@click.argument("folder", type=NewFile(file_okay=False))
@click.argument("session_files", nargs=-1, required=True, type=click.Path(exists=True, dir_okay=False))
@click.option("--task", required=True, help="What the robots do, in a sentence; of all episodes.")
@click.option(
    "--fps", type=click.IntRange(1), help="Frames per second, a divisor of the rate; default: every tick."
)
def lerobot(folder: str, session_files: tuple[str, ...], task: str, fps: int | None) -> None:
    """Write SESSION_FILES as a LeRobot dataset (v3.0) in FOLDER, an episode each.

    observation.state are the measured axes, action the commanded ones, observation.tip the tips by forward
    kinematics; in mm and bar.
    """
    from contid.session.read import Session
    from contid_sessions.lerobot import export_lerobot

    with counting("ticks read") as count:
        sessions = [Session(Path(name), count) for name in session_files]
        episodes = export_lerobot(sessions, Path(folder), task, fps)
    for number, (session, episode) in enumerate(zip(sessions, episodes, strict=True)):
        repeated = f", {episode.repeated} repeat the last answer of a device" if episode.repeated else ""
        click.echo(f"episode {number}: {session.path}, {episode.frames} frames{repeated}")
        _note_cut(session)


def _note_cut(session: Session) -> None:
    if session.end.cut:
        click.echo(f"contid: {session.path}: {session.end.cut}; exported as far as it goes", err=True)


def file_to_draw(session: Session, robot: str | None) -> LoadedFile:
    """The robot file for the shapes of a session: the recorded one, or another with the same axes."""
    from contid.robot_file.load import load_named
    from contid_sessions.replay.differences import refuse_other_robots

    if robot is None:
        return session.robot_file()
    loaded = load_named(robot)
    refuse_other_robots(session, loaded)
    return loaded


@click.command("merge")
@click.argument("sessions", nargs=-1, required=True, type=click.Path(exists=True, dir_okay=False))
@click.option(
    "-o", "--output", required=True, type=NewFile(dir_okay=False), help="New file, for Foxglove and others."
)
def merge(sessions: tuple[str, ...], output: str) -> None:
    """Lay SESSIONS of the nodes of a fleet run on one clock, in one file with channels /NODE/tick and so on.

    The times are those of the machine that conducted the run. A merged file is for looking at: check, export
    and replay take the originals.
    """
    from contid_sessions.merge import merge_sessions

    report = merge_sessions([Path(path) for path in sessions], Path(output))
    for name, count in report.messages.items():
        start_s, bound_ms = report.start_s[name], report.bound_s[name] * 1e3
        click.echo(f"{name}: {count} messages, from {start_s:.3f} s on (+-{bound_ms:.2f} ms)")


def _refuse_recording(path: Path) -> None:
    """Recordings are never overwritten, by exports neither.

    Raises:
        ContidError: the file is a recording.
    """
    from contid.session.format.mcap_records import MAGIC
    from contid.session.write import exists_error

    if path.is_file():
        with path.open("rb") as file:
            if file.read(len(MAGIC)) == MAGIC:
                raise exists_error(path)
