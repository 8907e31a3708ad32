"""``contid modes``: frequencies and damping of a robot's body."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import click

from contid.cli.support.parameters import NumberRange, robot_names
from contid_dynamics.pose_option import POSE, actuation_at, moving_robots

if TYPE_CHECKING:
    from contid_dynamics.report import PoseModes


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@POSE
@click.option("--count", type=click.IntRange(1, 24), default=4, show_default=True, help="Modes of a pose.")
@click.option("--payload-g", type=NumberRange(0.0), default=0.0, help="A mass on the tip besides the file's.")
@click.option(
    "--poses", type=click.IntRange(0, 1000), default=0, help="Also the range over this many random poses."
)
@click.option("--json", "as_json", is_flag=True, help="The numbers and shapes as one JSON object.")
def command(
    robot_file: str, at: tuple[str, ...], count: int, payload_g: float, poses: int, as_json: bool
) -> None:
    """How fast the body of each robot of ROBOT_FILE swings, and how soon it stops.

    The modes are those of small motions about a pose, from the linearised model; robots need `dynamics`.

    `contid modes stiffflop2 --at s1.p1_bar=0.6 --payload-g 10 --poses 100`
    """
    from contid_dynamics.report import pose_modes, range_over_poses

    found: dict[str, object] = {}
    for name, robot in moving_robots(robot_file).items():
        actuation = actuation_at(robot, name, at)
        modes = pose_modes(robot, actuation, count, payload_g)
        ranges = range_over_poses(robot, poses, count, payload_g) if poses else None
        if as_json:
            found[name] = {**modes.to_json(), **({} if ranges is None else {"ranges_hz": ranges})}
        else:
            _print(name, modes, ranges)
    if as_json:
        click.echo(json.dumps(found))


def _print(name: str, modes: PoseModes, ranges: list[tuple[float, float]] | None) -> None:
    x, y, z = modes.tip_mm
    click.echo(f"{name}: tip at x {x:.1f}, y {y:.1f}, z {z:.1f} mm")
    click.echo(
        "  mode  frequency  damping ratio  until 1 %  tip moves along" + ("  over poses" if ranges else "")
    )
    for k, mode in enumerate(modes.modes):
        ends = f"{mode.settles_s:.2f} s" if mode.settles_s < 1e4 else "never"
        along = " ".join(f"{part:+.2f}" for part in mode.direction) if mode.direction else "it stands"
        over = f"  {ranges[k][0]:.2f} to {ranges[k][1]:.2f} Hz" if ranges else ""
        click.echo(
            f"  {k + 1:4}  {mode.frequency_hz:6.2f} Hz  {mode.ratio:13.3f}  {ends:>9}  {along:15}{over}"
        )
    first = modes.modes[0]
    if 0.0 < first.ratio < 0.5:
        shape = f"{{frequency_hz: {first.frequency_hz:.2f}, damping_ratio: {first.ratio:.3f}}}"
        click.echo(f"  rates with shape: {shape} end without this swing")
