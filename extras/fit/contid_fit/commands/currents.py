"""``contid calibrate currents``: the usual current of a finger, from recordings without a contact."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import click

from contid.cli.support.parameters import CHANGED_FILE, NumberRange
from contid.cli.support.streams import counting


@click.command()
@click.argument("session_files", nargs=-1, required=True, type=click.Path(exists=True, dir_okay=False))
@click.option("--write", type=CHANGED_FILE, help="Robot file that gets the current.")
@click.option("--robot", help="Name of the finger; needed where there are several.")
@click.option(
    "--margin-percent",
    type=NumberRange(0.0, 200.0),
    default=20.0,
    show_default=True,
    help="By which usual_ma is above the greatest current.",
)
def command(
    session_files: tuple[str, ...], write: Path | None, robot: str | None, margin_percent: float
) -> None:
    """Find `sense.usual_ma` of a finger in SESSION_FILES in which it moved without touching anything.

    The servos report their currents. Record the motions that are used, with their speeds, over the whole
    reach: friction differs from place to place. With --write the robot file gets the current.
    """
    from contid.robot_file.edit import Change
    from contid.robot_file.load import load_robot_file
    from contid.session.read import Session
    from contid_fit.calibrate.target_robot import write_back
    from contid_fit.sense.usual_current import finger_of, usual_currents, usual_ma

    with counting("ticks read") as count:
        sessions = [Session(Path(each), count) for each in session_files]
        name, finger = finger_of(sessions[0].robot_file(), robot)
        found = usual_currents(sessions, name, finger)
    for each in found:
        click.echo(
            f"{each.axis}: at most {1e3 * each.greatest_a:.0f} mA (at {each.at_s:.2f} s in {each.file}), "
            f"999 of 1000 within {1e3 * each.usually_a:.0f} mA; {each.samples} samples, "
            f"{each.moving_s:.1f} s in motion"
        )
    usual = usual_ma(found, margin_percent / 100.0)
    click.echo(f"{name}: usual_ma: {usual}  # the greatest and {margin_percent:g} %")
    if write is None:
        return
    _, target = finger_of(load_robot_file(write), name)
    note = f"found {date.today().isoformat()} in {', '.join(Path(each).name for each in session_files)}"
    if target.sense is None:
        keys = {"contact": "ignore", "usual_ma": usual, "contact_ma": max(usual, 50)}
        change = Change("sense", keys, note)
    else:
        change = Change("sense.usual_ma", usual, note)
    write_back(write, name, [change])
    click.echo(f"written to {write}", err=True)
