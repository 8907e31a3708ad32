"""``contid identify``: delay, lag and swing of a robot from its recordings."""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path

import click

from contid.cli.support.parameters import NewFile, NumberRange, robot_names
from contid_identify.robot_option import MAP, ROBOT, azimuths_of, chosen_robot, recorded


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.argument(
    "sessions", nargs=-1, required=True, type=click.Path(exists=True, dir_okay=False, path_type=Path)
)
@ROBOT
@MAP
@click.option("--ring-down", is_flag=True, help="Also frequency and damping, from rests behind moves.")
@click.option("--body", is_flag=True, help="Also mass and damping of the body, from the same rests.")
@click.option(
    "--settle",
    "settle_s",
    type=NumberRange(0.0, 10.0),
    default=0.2,
    show_default=True,
    help="Time until the devices stand behind a move, for --ring-down and --body [s].",
)
@click.option(
    "--motion",
    "motion_file",
    type=NewFile(dir_okay=False, path_type=Path),
    help="Also the tip in motion, as a file of numbers for `contid predict`.",
)
@click.option(
    "--form",
    type=click.Choice(["map", "bends", "arcs"]),
    help="Of --motion: bends of the sections of a tendon robot in front of the map; arcs of chambers, which "
    "predict patterns that were not recorded. Default: map.",
)
@click.option(
    "--azimuths-deg",
    "azimuths",
    metavar="LIST",
    help="To which side each chamber bends its section, for arcs: `0,180,none`, none for chambers that only "
    "lengthen it. Default: by the statics of the file.",
)
@click.option(
    "--load-g",
    "loads_g",
    type=NumberRange(0.0, 1e5),
    multiple=True,
    help="Payload of each session in turn, for --motion; default: 0.",
)
@click.option("--write", is_flag=True, help="Write delay and lag, or the swing, into ROBOT_FILE.")
@click.option(
    "--html", type=NewFile(dir_okay=False, path_type=Path), help="Also write a page with the figures."
)
@click.option("--json", "as_json", is_flag=True, help="The numbers as one JSON object.")
def command(
    robot_file: str,
    sessions: tuple[Path, ...],
    name: str | None,
    map_file: Path | None,
    ring_down: bool,
    body: bool,
    settle_s: float,
    motion_file: Path | None,
    form: str | None,
    azimuths: str | None,
    loads_g: tuple[float, ...],
    write: bool,
    html: Path | None,
    as_json: bool,
) -> None:
    """Identify how a robot of ROBOT_FILE moves, from recordings (SESSIONS) of it: of contid, or tables.

    Each stage is judged on blocks of time kept out of its fit and has 95 % intervals. What the recordings
    cannot show is stated first.

    `contid identify arm.yaml shake.mcap --ring-down --write`
    """
    from contid.errors import ContidError, require_extra
    from contid.robot_file.base import Quantity
    from contid.robot_file.load import load_named
    from contid_identify.printed import lines, motion_lines, numbers
    from contid_identify.stages import Rests, arm_of_form, identify, tip_motion
    from contid_identify.written import changes

    require_extra("contid identify", "scipy")
    robots = load_named(robot_file).driven
    name = chosen_robot(robot_file, robots, name)
    if write and not Path(robot_file).is_file():
        raise ContidError(
            f"--write: {robot_file} is not a file of yours; `contid new NAME --from {robot_file}` makes one"
        )
    if loads_g and (motion_file is None or len(loads_g) != len(sessions)):
        raise ContidError(
            f"--load-g {len(loads_g)} times for {len(sessions)} sessions; give it once for each, and --motion"
        )
    if form is not None and motion_file is None:
        raise ContidError("--form is the form of what --motion writes; give --motion FILE too")
    if azimuths is not None and form != "arcs":
        raise ContidError("--azimuths-deg is for arcs of chambers; give --motion FILE --form arcs too")
    azimuths_rad = azimuths_of(azimuths)
    loads_kg = [1e-3 * each for each in loads_g]
    arm_of_form(name, robots[name], loads_kg, form or "map", azimuths_rad)  # refused before the long fits
    recordings = [recorded(path, name, robots[name], map_file) for path in sessions]
    rests = Rests(settle_s, ring_down, body) if ring_down or body else None
    found = identify(name, robots[name], recordings, rests)
    if as_json:
        click.echo(json.dumps(numbers(found)))
    else:
        for line in lines(found):
            click.echo(line)
    if motion_file is not None:
        from contid_identify.chambers.file import write_motion

        source = f"{', '.join(path.name for path in sessions)} on {date.today().isoformat()}"
        model = tip_motion(name, robots[name], recordings, loads_kg, source, form or "map", azimuths_rad)
        if form is None and robots[name].quantity is Quantity.PRESSURE and not any(loads_g):
            click.echo(
                "a pneumatic arm: the map is right only for patterns of pressure as they were recorded; "
                "`--form arcs` also predicts others",
                err=True,
            )
        write_motion(model, motion_file)
        for line in motion_lines(model):
            click.echo(line, err=as_json)
        click.echo(f"written to {motion_file}", err=True)
    if html is not None:
        from contid.whole_file import replacing
        from contid_identify.page import page

        with replacing(html) as file:
            file.write(page(found).encode())
        click.echo(f"written to {html}", err=True)
    if write:
        from contid_fit.calibrate.target_robot import write_back

        source = ", ".join(path.name for path in sessions)
        note = f"identified {date.today().isoformat()} from {source}"
        of_file = changes(found, robots[name], note)
        write_back(Path(robot_file), name, of_file.changes, [])
        for edit in of_file.changes:
            click.echo(f"written to {robot_file}: {edit.key}: {json.dumps(edit.value)}", err=True)
        for each in of_file.unknown:
            click.echo(f"not written: {each}", err=True)
        if of_file.left_out:
            raise ContidError(f"{'; '.join(of_file.left_out)}; everything else was written")
