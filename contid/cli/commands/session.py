"""``contid session info|check|export|load|repair``: what is done with a recording."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import click

from contid.cli.support.files import NewFile
from contid.cli.support.numbers import NUMBER
from contid.cli.support.progress import counting

if TYPE_CHECKING:
    from contid.robot_file.load import LoadedFile
    from contid.session.read import Session

#: Violations that a check lists.
MAX_VIOLATIONS = 100

SESSION = click.argument("session_file", type=click.Path(exists=True, dir_okay=False))


@click.group()
def command() -> None:
    """Summarise, check, export or repair a recorded session."""


@command.command()
@SESSION
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def info(session_file: str, as_json: bool) -> None:
    """Print duration, ticks, robots, faults, events, versions."""
    from contid.session.info import summarize
    from contid.session.read import Session

    with counting("ticks read") as count:
        summary = summarize(Session(Path(session_file), count))
    click.echo(json.dumps(asdict(summary)) if as_json else str(summary))


@command.command()
@SESSION
@click.option("--json", "as_json", is_flag=True, help="Print the violations as JSON.")
def check(session_file: str, as_json: bool) -> None:
    """Check the motion of SESSION_FILE against the rules, from its records alone.

    Limits of position, velocity, acceleration and jerk; no jump at arming; an emergency stop within its tick;
    growing time; an event for every fault. Exit code 1 when a rule was broken.
    """
    from contid.session.check import check_session
    from contid.session.read import Session

    with counting("ticks read") as count:
        session = Session(Path(session_file), count)
        found = list(islice(check_session(session), MAX_VIOLATIONS + 1))
    more = len(found) > MAX_VIOLATIONS
    found = found[:MAX_VIOLATIONS]
    if as_json:
        click.echo(
            json.dumps({"ok": not found, "more": more, "violations": [asdict(each) for each in found]})
        )
    else:
        lines = [*map(str, found), "further violations are not listed"] if more else [*map(str, found)]
        click.echo("\n".join(lines) or "no rule of motion was broken")
    if session.cut and not more:
        click.echo(f"contid: {session.path}: {session.cut}; checked as far as it goes", err=True)
    if found:
        sys.exit(1)


@command.command()
@SESSION
@click.option("--csv", "csv_path", type=NewFile(), help="FILE.csv: one table; else a folder of channels.")
@click.option("--rrd", "rrd_path", type=NewFile(dir_okay=False), help="A recording for the Rerun viewer.")
@click.option(
    "--yaml", "yaml_path", type=NewFile(dir_okay=False), help="The robot file it was recorded with."
)
@click.option("--robot", help="Robot file for the shapes in the .rrd instead of the recorded one.")
def export(
    session_file: str, csv_path: str | None, rrd_path: str | None, yaml_path: str | None, robot: str | None
) -> None:
    """Write SESSION_FILE as CSV (mm, bar), as a Rerun recording, or its robot file."""
    from contid.session.export import export_channels, export_joined, export_robot_file, refuse_recording
    from contid.session.read import Session

    outputs = [Path(path) for path in (csv_path, rrd_path, yaml_path) if path is not None]
    if not outputs:
        raise click.UsageError(
            "give an output: --csv FOLDER, --csv FILE.csv, --rrd FILE.rrd, --yaml FILE.yaml"
        )
    with counting("ticks read") as count:
        session = Session(Path(session_file), count)
        for path in outputs:
            refuse_recording(path)
        if yaml_path is not None:
            export_robot_file(session, Path(yaml_path))
        written = [] if yaml_path is None else [Path(yaml_path)]
        if csv_path is not None:
            export_tables = export_joined if csv_path.endswith(".csv") else export_channels
            written += export_tables(session, Path(csv_path))
        if rrd_path is not None:
            _export_rrd(session, robot, Path(rrd_path))
            written.append(Path(rrd_path))
    click.echo("\n".join(map(str, written)))
    if session.cut:
        click.echo(f"contid: {session.path}: {session.cut}; exported as far as it goes", err=True)


@command.command()
@SESSION
@click.option(
    "--unloaded",
    required=True,
    type=click.Path(exists=True, dir_okay=False),
    help="Session without load: rests at many pressures, with measured tips.",
)
@click.option("--robot", help="Name of the arm; needed where there are several.")
@click.option("--noise-mm", type=NUMBER, default=0.3, show_default=True, help="Of one measured tip.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object per rest.")
def load(session_file: str, unloaded: str, robot: str | None, noise_mm: float, as_json: bool) -> None:
    """Estimate the force on the tip at every rest of SESSION_FILE, with its 95 % interval.

    A rest is an interval of constant commands with measured tips. The error of the model is identified in
    another session of the same arm without load, so that it is not reported as a load. For model cosserat.
    """
    from contid.sense.session_loads import rod_of, session_calibration, session_loads
    from contid.session.read import Session

    if not noise_mm > 0.0:
        raise click.BadParameter(f"{noise_mm:g}; allowed: above 0", param_hint="--noise-mm")
    noise_m = noise_mm / 1e3
    with counting("ticks read") as count:
        reference = Session(Path(unloaded), count)
        name, arm = rod_of(reference.robot_file(), robot)
        calibration = session_calibration(reference, name, arm, noise_m)
        session = Session(Path(session_file), count)
        if name not in session.robots:
            raise click.ClickException(f"{session_file}: no robot {name!r}")
        found = list(session_loads(session, name, arm, calibration, noise_m))
    click.echo(
        f"{name}: {calibration.poses} rests without load; the tip of the model was off by "
        f"{calibration.before_m * 1e3:.3g} mm rms, corrected by {calibration.residual_m * 1e3:.3g} mm",
        err=True,
    )
    for each in found:
        if as_json:
            click.echo(json.dumps(asdict(each)))
            continue
        force = ", ".join(f"{v:.4f}" for v in each.force_n)
        half = ", ".join(f"{v:.4f}" for v in each.interval_n)
        click.echo(
            f"{each.start_s:.2f} to {each.end_s:.2f} s: "
            f"{each.mass_g:.2f} g ± {each.mass_interval_g:.2f} g along gravity; "
            f"force ({force}) N ± ({half}) N" + ("" if each.converged else "; not converged")
        )
    if not found:
        raise click.ClickException(f"{session_file}: {name} never rests with measured tips")


@command.command()
@SESSION
@click.option("--output", type=NewFile(dir_okay=False), help="Where to; SESSION_FILE is replaced if absent.")
def repair(session_file: str, output: str | None) -> None:
    """Repair a truncated SESSION_FILE.

    The incomplete tick is dropped; the rest is indexed and compressed.
    """
    from contid.session.repair import repair as repaired

    with counting("ticks read") as count:
        summary = repaired(Path(session_file), None if output is None else Path(output), count)
    click.echo(summary)


def _export_rrd(session: Session, robot: str | None, path: Path) -> None:
    loaded = file_to_draw(session, robot)
    os.environ.setdefault("RUST_LOG", "off")  # contid reports errors itself
    from contid.view.export import draw
    from contid.view.view_target import Kind, ViewTarget

    entries = ((entry.values, entry.event) for entry in session.entries())
    draw(entries, loaded, session.layout, ViewTarget(Kind.FILE, path))


def file_to_draw(session: Session, robot: str | None) -> LoadedFile:
    """The robot file for the shapes of a session: the recorded one, or another with the same axes."""
    from contid.robot_file.shipped import load_named
    from contid.session.differences import refuse_other_robots

    if robot is None:
        return session.robot_file()
    loaded = load_named(robot)
    refuse_other_robots(session, loaded)
    return loaded
