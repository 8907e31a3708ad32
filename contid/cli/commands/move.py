"""``contid move``: to a point, or along a trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TextIO

import click

from contid import entry_points
from contid.cli.support.added_options import ExtendedCommand, GoalOption
from contid.cli.support.orders import json_option, send, socket_option
from contid.cli.support.parameters import ROWS_FILE, NumberRange

if TYPE_CHECKING:
    from contid.client import Client


@click.command(cls=ExtendedCommand, group=entry_points.GOALS)
@click.argument("message", nargs=-1, metavar="[ROBOT] COLUMN=VALUE...")
@click.option("--trajectory", type=ROWS_FILE, help="CSV rows to follow instead of a point; - for stdin.")
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
    grip: float | None,
    until_force_n: float | None,
    takeover: bool,
    no_wait: bool,
    socket: str | None,
    as_json: bool,
    **values: Any,
) -> None:
    """Send robots to a point, or along the rows of --trajectory, and hold there.

    Columns are those of a trajectory: `contid move x_mm=40 y_mm=75`, `contid move left x_mm=40 y_mm=75`,
    `contid move left.x_mm=40 left.y_mm=75 right.x_mm=60 right.y_mm=75`. Axes of a robot that are left out
    beside others stay: `contid move finger left_mm=58`. Ctrl-C holds.

    With --until-force-n fingers hold an object; the point is behind its surface, and any later order releases
    it: `contid move left x_mm=55 y_mm=75 --until-force-n 3`.

    With --grip axes in current_based_position mode push with less current: `contid move left --grip 0.3`.
    """
    from contid.client import RemoteError
    from contid.remote.client.move_arguments import point, rows_to_send, with_other_axes

    robots = tuple(part for part in message if "=" not in part)
    added: Mapping[str, GoalOption] = command.added
    goals = [goal for goal in added.values() if goal.given(values)]
    only_grip = grip is not None and trajectory is None and not goals and len(robots) == len(message)
    if not only_grip and bool(message) + (trajectory is not None) + len(goals) != 1:
        others = "".join(f", {goal.options[0].opts[0]}" for goal in added.values())
        raise click.UsageError(f"give a point (COLUMN=VALUE...){others} or --trajectory, one of them")
    if until_force_n is not None and (trajectory is not None or only_grip):
        raise click.UsageError("--until-force-n needs a point (COLUMN=VALUE...) or --pose")

    def request(client: Client) -> dict[str, Any]:
        if takeover:
            client.acquire(takeover=True)
        if grip is not None:
            limited = client.grip(grip, robots or None)
            if only_grip:
                return limited
        if trajectory is None:
            goal = (
                goals[0].target(client, values)
                if goals
                else with_other_axes(target, client.describe(), client.status())
            )
            return {"move": client.move(goal, until_force_n=until_force_n, wait=not no_wait)}
        try:
            refused = client.stream(columns, rows)
        except RemoteError as error:
            raise RemoteError(error.code, rows.located(str(error)), error.faults) from None
        return {"refused": [rows.located(each) for each in refused]}

    if trajectory is None:
        target = {} if only_grip or goals else point(message)
    else:
        columns, rows = rows_to_send(trajectory)
    send(socket, as_json, request)
