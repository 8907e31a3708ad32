"""``contid move``: to a point, or along a trajectory."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

from contid.cli.support.files import ROWS_FILE
from contid.cli.support.numbers import NumberRange
from contid.cli.support.orders import json_option, send, socket_option

if TYPE_CHECKING:
    from contid.client import Client


@click.command()
@click.argument("message", nargs=-1, metavar="[ROBOT] COLUMN=VALUE...")
@click.option("--trajectory", type=ROWS_FILE, help="CSV rows to follow instead of a point; - for stdin.")
@click.option("--pose", help="Go to this named pose instead of a point.")
@click.option(
    "--poses",
    type=click.Path(path_type=Path, dir_okay=False),
    help="File of --pose; default ROBOTFILE.poses.yaml or poses.yaml beside the daemon's robot file.",
)
@click.option(
    "--grip",
    type=NumberRange(0.0, 1.0),
    help="Push with this share of the robot file's current; also without a point.",
)
@click.option(
    "--until-force-n",
    type=NumberRange(0.0, 1000.0, min_open=True),
    help="Close slowly towards the point until each tip exerts this force along its way, and hold it.",
)
@click.option("--takeover", is_flag=True, help="Take the lease from its holder; the robots hold.")
@click.option("--no-wait", is_flag=True, help="Return before the point is reached.")
@socket_option
@json_option
def command(
    message: tuple[str, ...],
    trajectory: TextIO | None,
    pose: str | None,
    poses: Path | None,
    grip: float | None,
    until_force_n: float | None,
    takeover: bool,
    no_wait: bool,
    socket: str | None,
    as_json: bool,
) -> None:
    """Send robots to a point, or along the rows of --trajectory, and hold there.

    Columns are those of a trajectory: `contid move x_mm=40 y_mm=75`, `contid move left x_mm=40 y_mm=75`,
    `contid move left.x_mm=40 left.y_mm=75 right.x_mm=60 right.y_mm=75`. Ctrl-C holds.

    With --until-force-n fingers hold an object; the point is behind its surface, and any later order releases
    it: `contid move left x_mm=55 y_mm=75 --until-force-n 3`.

    With --grip axes in current_based_position mode push with less current: `contid move left --grip 0.3`.
    """
    from contid.remote.client.move_arguments import columns_and_rows, point

    robots = tuple(part for part in message if "=" not in part)
    only_grip = grip is not None and trajectory is None and pose is None and len(robots) == len(message)
    if not only_grip and sum((bool(message), trajectory is not None, pose is not None)) != 1:
        raise click.UsageError("give a point (COLUMN=VALUE...), --pose or --trajectory, one of them")
    if until_force_n is not None and (trajectory is not None or only_grip):
        raise click.UsageError("--until-force-n needs a point (COLUMN=VALUE...) or --pose")
    if poses is not None and pose is None:
        raise click.UsageError("--poses names the file of --pose")

    def request(client: Client) -> dict[str, Any]:
        if takeover:
            client.acquire(takeover=True)
        if grip is not None:
            limited = client.grip(grip, robots or None)
            if only_grip:
                return limited
        if trajectory is None:
            goal = target if pose is None else _target_of(client, pose, poses)
            return {"move": client.move(goal, until_force_n=until_force_n, wait=not no_wait)}
        return {"refused": client.stream(columns, rows)}

    if trajectory is None:
        target = {} if only_grip or pose is not None else point(message)
    else:
        columns, rows = columns_and_rows(trajectory)
    send(socket, as_json, request)


def _target_of(client: Client, name: str, file: Path | None) -> dict[str, float]:
    """The target of a named pose, compared with the robots of the daemon."""
    from contid.teach.check_targets import check_targets
    from contid.teach.pose_file import read_pose_file
    from contid.teach.pose_store import default_pose_file

    describe = client.describe()
    read = read_pose_file(file or default_pose_file(Path(describe["file"])))
    target = dict(read.pose(name).target)
    check_targets(read, describe, {name})
    return target
