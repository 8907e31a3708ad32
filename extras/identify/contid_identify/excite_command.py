"""``contid excite``: a trajectory that shows how a robot moves."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import click

from contid.cli.support.parameters import NewFile, NumberRange, robot_names
from contid_identify.robot_option import ROBOT, chosen_robot

_KINDS: Final = ("steps", "sines", "chirp", "ring-downs")


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.option(
    "-o", "--output", type=NewFile(dir_okay=False, path_type=Path), required=True, help="A CSV to write."
)
@ROBOT
@click.option(
    "--duration",
    "duration_s",
    type=NumberRange(10.0, 600.0),
    default=60.0,
    show_default=True,
    help="About how long [s].",
)
@click.option(
    "--part",
    "kinds",
    type=click.Choice(_KINDS),
    multiple=True,
    help="Parts in order; default: each once.",
)
@click.option(
    "--upper-hz",
    type=NumberRange(0.2, 20.0),
    default=2.0,
    show_default=True,
    help="Highest frequency of steps, sines and chirp.",
)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="Of the random parts.")
def command(
    robot_file: str,
    output: Path,
    name: str | None,
    duration_s: float,
    kinds: tuple[str, ...],
    upper_hz: float,
    seed: int,
) -> None:
    """Write a trajectory that shows how a robot of ROBOT_FILE moves, inside its limits and its clearance.

    Every part is made smaller or slower until the check of `contid check` accepts it. Record a run of it:

    `contid excite tendon3 -o shake.csv`

    `contid run tendon3 --trajectory shake.csv --record shake.mcap`

    `contid identify tendon3 shake.mcap`
    """
    from contid.robot_file.load import load_named
    from contid.whole_file import replacing
    from contid_identify.excite import exciting

    loaded = load_named(robot_file)
    name = chosen_robot(robot_file, loaded.driven, name)
    found = exciting(loaded, name, duration_s, kinds or _KINDS, upper_hz, seed)
    with replacing(output) as file:
        file.write(found.text.encode())
    for part in found.parts:
        size = f"{100.0 * part.share:3.0f} % of the first size"
        slowed = f", {part.slowed:.2g} times as slow" if part.slowed > 1.0 else ""
        click.echo(f"  {part.name:10} {part.duration_s:5.1f} s, {size}{slowed}")
    click.echo(f"{output}: {found.duration_s:.1f} s for {name}, accepted as `contid check` does")
