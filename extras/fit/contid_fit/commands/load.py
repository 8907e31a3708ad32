"""``contid calibrate load``: the error of a pneumatic arm without load, from a recording."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import click

from contid.cli.support.parameters import CHANGED_FILE, POSITIVE, SESSION
from contid.cli.support.streams import counting


@click.command()
@SESSION
@click.option("--write", type=CHANGED_FILE, help="Robot file that gets the calibration.")
@click.option("--robot", help="Name of the arm; needed where there are several.")
@click.option(
    "--noise-mm", type=POSITIVE, default=0.3, show_default=True, help="Standard deviation of a measured tip."
)
def command(session_file: str, write: Path | None, robot: str | None, noise_mm: float) -> None:
    """Identify the error of an arm's model in SESSION_FILE: rests at many pressures without load.

    The session has measured tips of a tracker. With --write the result becomes ``sense.load.calibration`` of
    the robot file, and the arm estimates the force on its tip in every run.
    """
    from contid.robot_file.edit import Change
    from contid.robot_file.load import load_robot_file
    from contid.session.read import Session
    from contid_fit.calibrate.target_robot import write_back
    from contid_fit.sense.session_loads import rod_of, session_calibration
    from contid_fit.sense.written import calibration_keys

    with counting("ticks read") as count:
        session = Session(Path(session_file), count)
        name, arm = rod_of(session.robot_file(), robot)
        found = session_calibration(session, name, arm, noise_mm / 1e3, reported=True)
    before, after = found.before_m * 1e3, found.residual_m * 1e3
    click.echo(f"{name}: {found.poses} rests without load")
    click.echo(f"  tip of the model off by {before:.3g} mm rms, corrected by {after:.3g} mm")
    family = found.family
    for parameter, unit, value in zip(family.names, family.units, found.parameters.tolist(), strict=True):
        click.echo(f"  {parameter} {value:+.4g} {unit}" if unit else f"  {parameter} {100.0 * value:+.2f} %")
    creep, sigma = 100.0 * found.creep.per_decade, 100.0 * found.creep.sigma
    click.echo(f"  creep {creep:+.2f} % of the modulus per decade of time, at one rest within {sigma:.2f} %")
    if write is None:
        return
    keys = calibration_keys(arm, found)
    note = f"calibrated {date.today().isoformat()} from {Path(session_file).name}, {after:.3g} mm rms remain"
    _, target = rod_of(load_robot_file(write), name)
    if target.sense is None:
        change = Change("sense", {"load": {"noise_mm": noise_mm, "calibration": keys}}, note)
    else:
        change = Change("sense.load.calibration", keys, note)
    write_back(write, name, [change])
    click.echo(f"written to {write}", err=True)
