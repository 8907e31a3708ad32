"""``contid path`` and ``contid retime``: a shape as a trajectory on stdout, and the fastest timing."""

from __future__ import annotations

import io
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, TextIO

import click

from contid.cli.support.parameters import NUMBER, POSITIVE, Numbers, robot_names

if TYPE_CHECKING:
    from contid_paths.shapes import ShapePath

#: The two arms of a chain swing their rope.
SWING = "swing"
SHAPES = ("line", "circle", "ellipse", "square", "box", "spiral", "corners", "traverse", "diagonal")


@click.command()
@click.argument("shape", type=click.Choice((*SHAPES, SWING)))
@click.option("--center", type=Numbers(2, 3, NUMBER), help="Centre x,y or x,y,z in the world [mm]; 0,0.")
@click.option("--radius", type=POSITIVE, help="Greatest radius of circle, ellipse and spiral [mm].")
@click.option(
    "--size", type=POSITIVE, help="Side of squares, length of lines, diameter of round shapes [mm]."
)
@click.option("--height", type=NUMBER, help="z of the shape [mm]; spatial robots need it.")
@click.option("--dz", type=NUMBER, help="How much the height varies [mm]; 10 for a box, else 0.")
@click.option("--turns", type=POSITIVE, default=3.0, show_default=True, help="Turns of the spiral.")
@click.option(
    "--ratio", type=POSITIVE, default=2.0 / 3.0, help="Second semi-axis of ellipse and swing [2/3]."
)
@click.option("--angle", type=NUMBER, default=0.0, help="Rotation about the centre [deg].")
@click.option("--lean", type=NUMBER, help="Tilt of the tip's direction outward from +z [deg]: ax,ay,az.")
@click.option("--roll", type=NUMBER, help="With --lean: turn of the tip's frame about it [deg]: bx,by,bz.")
@click.option("--mid", "mid_text", help="Mid-point: x,y,z, or SHAPE:SIZE:HEIGHT about the same centre [mm].")
@click.option("--period", type=POSITIVE, default=4.0, show_default=True, help="Time of one lap [s].")
@click.option("--laps", type=POSITIVE, default=1.0, show_default=True, help="How many laps.")
@click.option("--rate", type=POSITIVE, default=50.0, show_default=True, help="Rows per second.")
@click.option(
    "--for",
    "robot_file",
    shell_complete=robot_names,
    metavar="ROBOT_FILE",
    help="Robot file, or the name of a shipped one: every robot's columns.",
)
@click.option("--fastest", is_flag=True, help="The fastest timing instead of --period, as `contid retime`.")
@click.option(
    "--robots", help="Only these robots, names separated by commas; without --for just their names."
)
def command(
    shape: str,
    center: tuple[float, ...] | None,
    radius: float | None,
    size: float | None,
    height: float | None,
    dz: float | None,
    turns: float,
    ratio: float,
    angle: float,
    lean: float | None,
    roll: float | None,
    mid_text: str | None,
    period: float,
    laps: float,
    rate: float,
    robot_file: str | None,
    fastest: bool,
    robots: str | None,
) -> None:
    """Print a trajectory that follows SHAPE.

    contid path circle --center 50,70 --radius 20 --period 4 --for hand | contid run hand --mock

    Positions are in the world frame, so robots that share a target get equal columns. With --for, and neither
    size nor place, it is a path about the rest pose of each robot that they can follow; what was chosen is
    printed on stderr.
    """
    if fastest and (robot_file is None or shape == SWING):
        raise click.UsageError("--fastest takes a shape with --for ROBOT_FILE, whose limits it needs")
    if shape == SWING:
        if angle or any(value is not None for value in (center, radius, dz, lean, roll, mid_text, robots)):
            raise click.UsageError("swing takes --for, --size, --ratio, --height, --period, --laps, --rate")
        if robot_file is None:
            raise click.UsageError("swing needs --for ROBOT.yaml with a chain in it")
        _swing(robot_file, size, ratio, height, period, laps, rate)
        return
    from contid_paths.shapes import Shape, ShapePath
    from contid_paths.table import PathRobot, robots_in_file, write_path

    kind = Shape(shape)
    chosen = robot_file is not None and not any((center, size, radius, mid_text)) and height is None
    center = center or (0.0, 0.0)
    if not chosen and (radius is None) == (size is None):
        raise click.UsageError("give --size or --radius" + (", not both" if size is not None else ""))
    if radius is not None and not kind.is_round:
        raise click.UsageError(f"a {shape} has no radius; give --size")
    if len(center) == 3 and height is not None:
        raise click.UsageError("--center x,y,z and --height both give z; use one of them")
    if roll is not None and (lean is None or mid_text is not None):
        raise click.UsageError("--roll goes with --lean (0 for +z) and without --mid")
    height = center[2] if len(center) == 3 else height
    names = [name.strip() for name in robots.split(",")] if robots else []
    if robot_file is not None:
        targets = robots_in_file(robot_file, names)
    else:
        targets = [
            PathRobot(f"{name}." if name else "", 2 if height is None else 3) for name in names or [""]
        ]
    if (
        height is None
        and not chosen
        and (dz or lean is not None or mid_text is not None or any(each.dimension == 3 for each in targets))
    ):
        raise click.UsageError("a spatial path needs --height (z in the world, mm)")
    plain = lean is None and mid_text is None  # what is planar refuses those by itself
    if height and plain and all(each.dimension == 2 for each in targets):
        raise click.UsageError(f"the robots of {robot_file} are planar: they have no z; leave it out")

    rise = dz if dz is not None else 10.0 if kind is Shape.BOX and height is not None else 0.0
    path = ShapePath(
        kind,
        (center[0], center[1]),
        size if size is not None else 2.0 * (radius or 1.0),
        height_mm=height or 0.0,
        dz_mm=rise,
        turns=turns,
        ratio=ratio,
        angle_deg=angle,
        lean_deg=lean,
        roll_deg=roll,
        period_s=period,
        laps=laps,
        rate_hz=rate,
    )
    if chosen and robot_file is not None:
        from contid_paths.about_rest import path_about_rest

        found = path_about_rest(robot_file, targets, path)
        path, targets = found.path, list(found.robots)
        click.echo(f"contid: {found}", err=True)
    mid = _mid(mid_text, path) if mid_text is not None else None
    if not fastest or robot_file is None:
        write_path(sys.stdout, path, targets, mid)
        return
    text = io.StringIO()
    write_path(text, path, targets, mid)
    print_fastest(robot_file, "the path", io.StringIO(text.getvalue()))


def _swing(
    robot_file: str,
    size: float | None,
    ratio: float,
    height: float | None,
    period: float,
    laps: float,
    rate: float,
) -> None:
    """The swing of the first chain of a file; at the height of its arms' rest pose when none is given."""
    from contid.kinematics.frames import BaseFrame
    from contid.kinematics.model import build_model
    from contid.robot_file.chain import Chain
    from contid.robot_file.load import load_named
    from contid.units import m_to_mm
    from contid_paths.swing import Swing
    from contid_paths.table import write_rows

    found = load_named(robot_file).file.robots
    chain = next((robot for robot in found.values() if isinstance(robot, Chain)), None)
    if chain is None:
        raise click.UsageError(f"{robot_file} describes no chain; a swing needs one (model: chain)")
    bases = [found[arm].base for arm in chain.arms]
    if height is None:
        first = found[chain.arms[0]]
        tip = build_model(first).forward(first.rest).tip_m
        height = m_to_mm(BaseFrame.of(first.base).point_in_world(tip)[2])
    places = [(base.x_mm, base.y_mm, base.z_mm) for base in bases]
    swing = Swing(
        chain.arms, (places[0], places[1]), 80.0 if size is None else size, ratio, height, period, laps, rate
    )
    write_rows(sys.stdout, swing.columns(), swing.rows())


def _mid(text: str, path: ShapePath) -> ShapePath | tuple[float, float, float]:
    """The value of ``--mid``: a fixed point, or a shape of its own about the centre of the path."""
    from contid_paths.shapes import Shape

    name, *numbers = text.split(":")
    try:
        if not numbers:
            x, y, z = Numbers(3, 3, NUMBER)(text)
            return (x, y, z)
        if len(numbers) != 2 or name not in SHAPES:
            raise click.BadParameter(f"{text!r} is neither x,y,z nor SHAPE:SIZE:HEIGHT.")
        size_mm, height_mm = POSITIVE(numbers[0]), NUMBER(numbers[1])
    except click.BadParameter as error:
        raise click.BadParameter(error.message, param_hint="'--mid'") from None
    return replace(
        path, shape=Shape(name), size_mm=size_mm, height_mm=height_mm, dz_mm=0.0, lean_deg=None, roll_deg=None
    )


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.argument("trajectory", type=click.Path(dir_okay=False, exists=True, allow_dash=True))
def retime(robot_file: str, trajectory: str) -> None:
    """Print TRAJECTORY (`-`: stdin) with the fastest timing for ROBOT_FILE, one row per tick.

    The path stays; its times are replaced, dwells are left out. Velocity, acceleration and jerk of every axis
    hold at every tick. Needs the extra `retime`.
    """
    print_fastest(robot_file, trajectory)


def print_fastest(robot_file: str, trajectory: str, text: TextIO | None = None) -> None:
    """Print the fastest timing of a file, or of ``text`` by that name."""
    from contid_paths.fastest import fastest_trajectory
    from contid_paths.table import write_rows

    found = fastest_trajectory(robot_file, trajectory, text)
    write_rows(sys.stdout, found.columns, found.rows.tolist())
    click.echo(
        f"contid: {found.duration_s:.4g} s; velocity, acceleration and jerk hold, {found.binding} binds",
        err=True,
    )
