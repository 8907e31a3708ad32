"""``contid adapt``: a trajectory from the table of another program or tracker."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryFile

import click

from contid.cli.support.parameters import NewFile, robot_names

#: Characters that are copied at a time.
_PART = 1 << 20


@click.command()
@click.argument("table", type=click.Path(dir_okay=False, exists=True))
@click.option(
    "--for", "robot_file", required=True, shell_complete=robot_names, help="The robot that is to follow it."
)
@click.option(
    "--map", "mapping", help="File with at most eight lines of YAML, or `auto` for the one that is proposed."
)
@click.option("-o", "--output", type=NewFile(dir_okay=False), help="Where to write the trajectory.")
def command(table: str, robot_file: str, mapping: str | None, output: str | None) -> None:
    """Make a trajectory for a robot from TABLE: CSV of any dialect, JSON, NumPy, Parquet, MATLAB.

    Without --map it prints the columns of the table and the mapping that it would use, and writes nothing.
    With it, time, units, directions and frame are checked against the data, then the robot's reach and speed
    as `contid check` does; only a trajectory that passes is written. docs/your-data.md has every line.
    """
    from contid.errors import ContidError
    from contid.whole_file import replacing
    from contid_adapt.adapt import check_written, mean
    from contid_adapt.known import propose
    from contid_adapt.reading.read import read_table

    found = read_table(table)
    if mapping is None or mapping == "auto":
        proposal = propose(found, robot_file)
        if mapping is None:
            click.echo(proposal.report(found))
            if output is not None:
                raise ContidError(
                    "nothing written: give the mapping with --map FILE, or take it with --map auto"
                )
            return
        if proposal.missing:
            raise ContidError(f"{table}: no mapping to take: {proposal.missing}")
        text, name = proposal.text, "auto"
    else:
        path = Path(mapping)
        try:
            text, name = path.read_text(encoding="utf-8"), mapping
        except (OSError, UnicodeDecodeError) as error:
            why = getattr(error, "strerror", None) or error
            raise ContidError(f"{mapping}: cannot read it: {why}") from error
    if output is None:
        raise ContidError("-o FILE is missing: where to write the trajectory")
    if Path(output).exists() and Path(output).samefile(table):
        raise ContidError(f"{output} is the table itself; write to another file")
    made = mean(found, robot_file, text, name)
    for note in made.notes:
        click.echo(note, err=True)
    del found
    with TemporaryFile("w+", encoding="utf-8", newline="") as checked:
        made = check_written(made, robot_file, checked)
        checked.seek(0)
        with replacing(Path(output)) as file:
            for part in iter(lambda: checked.read(_PART), ""):
                file.write(part.encode())
    click.echo(f"{output}: {made.accepted}")
