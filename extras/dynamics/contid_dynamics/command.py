"""``contid modes``: frequencies and damping of a robot's body."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from contid import entry_points
from contid.cli.support.added_options import ExtendedCommand
from contid.cli.support.parameters import NumberRange, robot_names
from contid_devices.homing.moving_commands import require_writable
from contid_dynamics.pose_option import POSE, actuation_at, moving_robots

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contid.robot_file.robot import RobotDescription
    from contid_dynamics.report import PoseModes

_ORIGIN: Final = "contid modes --schedule"
#: Random motions in which the fall of tensions is searched.
_TENSION_MOVES: Final = 60


@click.command(cls=ExtendedCommand, group=entry_points.MODES)
@click.argument("robot_file", shell_complete=robot_names)
@POSE
@click.option("--count", type=click.IntRange(1, 24), default=4, show_default=True, help="Modes of a pose.")
@click.option("--payload-g", type=NumberRange(0.0), default=0.0, help="A mass on the tip besides the file's.")
@click.option(
    "--poses", type=click.IntRange(0, 1000), default=0, help="Also the range over this many random poses."
)
@click.option(
    "--schedule",
    type=click.IntRange(1, 5000),
    help="Also frequencies over this many random poses, and up to --payload-g, for rates.shape; of tendon "
    "robots also how far tensions fall in motion, for tension.swing_n.",
)
@click.option("--write", is_flag=True, help="Write rates.shape with its schedule into ROBOT_FILE.")
@click.option("--json", "as_json", is_flag=True, help="The numbers and shapes as one JSON object.")
def command(
    robot_file: str,
    at: tuple[str, ...],
    count: int,
    payload_g: float,
    poses: int,
    schedule: int | None,
    write: bool,
    as_json: bool,
    **outputs: str | None,
) -> None:
    """How fast the body of each robot of ROBOT_FILE swings, and how soon it stops.

    The modes are those of small motions about a pose, from the linearised model; robots need `dynamics`.

    `contid modes stiffflop2 --at s1.p1_bar=0.6 --payload-g 10 --poses 100`

    `contid modes my_arm.yaml --schedule 300 --payload-g 10 --write`

    `contid modes tendon3 --at s1.t1_mm=3 --save modes.rrd`
    """
    from contid.errors import ContidError
    from contid.robot_file.load import find_robot_file, load_named
    from contid_dynamics.report import range_over_poses
    from contid_dynamics.swing import SwingingPose

    if write and schedule is None:
        raise click.UsageError("--write needs --schedule COUNT, the poses whose frequencies are written")
    if write:
        require_writable(find_robot_file(robot_file), "shape")
    found: dict[str, object] = {}
    schedules: dict[str, Mapping[str, Any]] = {}
    swinging: dict[str, SwingingPose] = {}
    robots = moving_robots(robot_file)
    for name, robot in robots.items():
        actuation = actuation_at(robot, name, at, robots.keys() - {name})
        try:
            swinging[name] = SwingingPose(robot, actuation, count, payload_g)
        except ArithmeticError as error:
            raise ContidError(f"{name}: no equilibrium at --at, or under --payload-g") from error
        modes = swinging[name].modes
        ranges = range_over_poses(robot, poses, count, payload_g) if poses else None
        if as_json:
            found[name] = {**modes.to_json(), **({} if ranges is None else {"ranges_hz": ranges})}
        else:
            _print(name, modes, ranges)
        if schedule is not None:
            schedules[name] = _schedule(robot, schedule, payload_g, quiet=as_json)
            if as_json:
                found[f"{name}.shape"] = schedules[name]["rates.shape"]
    if as_json:
        click.echo(json.dumps(found))
    if write:
        _write(find_robot_file(robot_file), schedules, quiet=as_json)
    elif schedules and not as_json:
        click.echo("  --write puts it into the robot file, --json prints it")
    for output, path in outputs.items():
        if path is not None:
            command.added[output].write(load_named(robot_file), swinging, Path(path))
            click.echo(f"  written to {path}; contid view {path} plays it", err=True)


def _schedule(robot: RobotDescription, poses: int, load_g: float, quiet: bool) -> Mapping[str, Any]:
    """Fit the schedule of a robot and print how well it fits; the values to write, by their keys."""
    from contid.robot_file.rates import InputShape
    from contid.robot_file.tendon.robot import TendonRobot
    from contid_dynamics.schedule import schedule_of
    from contid_dynamics.tension_swing import tension_swing

    found = schedule_of(robot, poses, load_g)
    values: dict[str, Any] = {"rates.shape": found.shape}
    if isinstance(robot, TendonRobot):
        assert robot.tension is not None
        swing = tension_swing(robot, InputShape.model_validate(found.shape), _TENSION_MOVES, load_g)
        floor_n = robot.tension.floor_n
        values["tension.swing_n"] = swing.swing_n
        if not quiet:
            click.echo(
                f"  tensions in {swing.moves} motions fall by {swing.median_n:.2f} N (median, greatest "
                f"{swing.greatest_n:.2f}) below those of the commands: with tension.swing_n "
                f"{swing.swing_n:g} they keep {floor_n:g} N; tighten the straight robot to "
                f"{floor_n + swing.swing_n:g} N"
            )
    low, high = found.shape["schedule"]["least_hz"], found.shape["schedule"]["most_hz"]
    medians, worst = ([f"{100 * each:.1f}" for each in pair] for pair in (found.median, found.worst))
    if not quiet:
        click.echo(
            f"  schedule: {low:g} to {high:g} Hz, fitted to {found.poses} poses; error on {found.kept_out} "
            f"kept aside: first mode {medians[0]} % (worst {worst[0]}), second {medians[1]} % "
            f"(worst {worst[1]})"
        )
        if found.outside:
            click.echo(
                f"  {found.outside} poses swing slower or faster than shaping takes: as at its edge there"
            )
    return values


def _write(path: Path, schedules: Mapping[str, Mapping[str, Any]], quiet: bool) -> None:
    """Write the schedules of all robots, or none."""
    from contid.robot_file.edit import Change, set_values

    changes = [
        Change(f"robots.{name}.{key}", value, _ORIGIN)
        for name, values in schedules.items()
        for key, value in values.items()
    ]
    set_values(path, changes)
    if not quiet:
        keys = dict.fromkeys(key for values in schedules.values() for key in values)
        click.echo(f"  {', '.join(keys)} written to {path}")


def _print(name: str, modes: PoseModes, ranges: list[tuple[float, float]] | None) -> None:
    from contid.robot_file.rates import HIGHEST_HZ, LOWEST_HZ

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
    if 0.0 < first.ratio < 0.5 and not LOWEST_HZ <= first.frequency_hz <= HIGHEST_HZ:
        click.echo(f"  its first mode is not shaped: rates.shape takes {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz")
    elif 0.0 < first.ratio < 0.5:
        shape = f"{{frequency_hz: {first.frequency_hz:.2f}, damping_ratio: {first.ratio:.3f}}}"
        click.echo(f"  rates with shape: {shape} end without this swing")
