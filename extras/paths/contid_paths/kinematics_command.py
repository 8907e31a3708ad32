"""``contid fk`` and ``contid ik``: rows of actuation to tip poses, rows of targets to actuation."""

from __future__ import annotations

import click

from contid.cli.support.parameters import robot_names


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.argument("rows", required=False, type=click.Path(allow_dash=True))
@click.option("--pose", is_flag=True, help="Also print the tip's direction and the mid-point.")
@click.option("--frame", is_flag=True, help="Also print the tip's direction and x axis: its frame.")
@click.option("--bends", is_flag=True, help="Print bend, azimuth and length of every section instead.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object per row instead of CSV.")
def fk(robot_file: str, rows: str | None, pose: bool, frame: bool, bends: bool, as_json: bool) -> None:
    """Forward kinematics: rows of actuation in (left_mm,right_mm or s1.p1_bar, ...), tip positions out.

    Rows of bends (s1.bend_deg,s1.azimuth_deg, ...) are taken too. ROWS is a file, or stdin when it is left
    out. Positions are in the world frame of the robot file. The output is what ``contid ik`` reads;
    ``contid ik --bare`` writes what this reads.
    """
    from contid.robot_file.load import load_named
    from contid_paths.converted_rows import convert_rows
    from contid_paths.solved_rows import ArcRows, ForwardRows

    loaded = load_named(robot_file)
    robots = loaded.driven
    if frame and (planar := [name for name, robot in robots.items() if robot.dimension == 2]):
        raise click.UsageError(f"--frame: {planar[0]} is planar; its direction is its frame (--pose)")
    if bends:
        if pose or frame:
            raise click.UsageError("--bends prints no tip; leave out --pose and --frame")
        shapes = {name: ArcRows(name, robot) for name, robot in robots.items()}
        convert_rows(loaded, rows, shapes, as_json)
        return
    tips = {name: ForwardRows(name, robot, pose, frame) for name, robot in robots.items()}
    convert_rows(loaded, rows, tips, as_json)


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.argument("rows", required=False, type=click.Path(allow_dash=True))
@click.option(
    "--bare",
    is_flag=True,
    help="Only the columns of `contid fk`, `shape` and `run`; a row out of reach is an error.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object per row instead of CSV.")
def ik(robot_file: str, rows: str | None, bare: bool, as_json: bool) -> None:
    """Inverse kinematics: rows of targets in (x_mm,y_mm[,z_mm], ... or s1.bend_deg, ...), actuation out.

    ROWS is a file, or stdin when it is left out. Every row adds residual_mm, converged, limited_by and
    iterations; a target out of reach gives the best actuation inside the limits, with
    converged=false. The solution of each row is the start of the next.
    """
    from contid.robot_file.load import load_named
    from contid_paths.converted_rows import convert_rows
    from contid_paths.solved_rows import InverseRows

    loaded = load_named(robot_file)
    answers = {name: InverseRows(name, robot, bare) for name, robot in loaded.driven.items()}
    convert_rows(loaded, rows, answers, as_json)
