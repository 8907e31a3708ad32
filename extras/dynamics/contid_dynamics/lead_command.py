"""``contid lead``: a trajectory whose commands make up for the lag and the body of its robot."""

from __future__ import annotations

from pathlib import Path

import click

from contid.cli.support.parameters import NewFile, NumberRange, robot_names


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.argument("trajectory", type=click.Path(path_type=Path, dir_okay=False, exists=True))
@click.option(
    "-o", "--output", required=True, type=NewFile(path_type=Path, dir_okay=False), help="File to write."
)
@click.option(
    "--ease",
    "ease_s",
    type=NumberRange(0.0, min_open=True),
    help="Seconds in which a path that is not at rest sets out, and stops.",
)
@click.option("--no-body", is_flag=True, help="Make up for delay and lag only, not for the first mode.")
def command(robot_file: str, trajectory: Path, output: Path, ease_s: float | None, no_body: bool) -> None:
    """Write axis values by which the robot of ROBOT_FILE does the path of TRAJECTORY.

    They lead it by the lag of `dynamics` and the first mode of the body; dead times delay the whole path. A
    path that does not begin or end at rest sets out and stops slowly. Where a limit of pressures, tensions or
    bends acts, the tip is kept as near as it lets. Check the result as any trajectory.

    `contid lead my_arm.yaml circle.csv -o led.csv`
    """
    from contid.errors import ContidError
    from contid.robot_file.load import load_named
    from contid.trajectory.read import read_trajectory
    from contid.whole_file import replacing
    from contid_dynamics.lead_file import led_file

    loaded = load_named(robot_file)
    if len(loaded.driven) != 1:
        raise ContidError(f"{robot_file} has {len(loaded.driven)} robots; a lead is for a file with one")
    # What is not UTF-8 is refused with the name of its column.
    with trajectory.open(encoding="utf-8", errors="replace") as file:
        read = read_trajectory(file, trajectory.name, loaded.driven)
    found = led_file(loaded, read, body=not no_body, ease_s=ease_s)
    with replacing(output) as out:
        out.write(found.text.encode())
    if found.ease_s:
        click.echo(f"the path is not at rest at its ends: it sets out and stops within {found.ease_s:.2f} s")
    if found.held:
        click.echo(f"a limit acts at {found.held} of {found.rows} rows")
    plain, ahead = (f"{1e3 * e.rms_m:.2f} mm rms ({1e3 * e.worst_m:.2f})" for e in (found.plain, found.ahead))
    click.echo(
        f"{output}: {found.rows} rows; the tip does the path {1e3 * found.later_s:.0f} ms later, off it by "
        f"{ahead} by the model, and by {plain} without the lead. Check it with contid check {robot_file} "
        f"{output}"
    )
