"""``contid predict``: how far a recording is from what the identified robot would do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from contid.cli.support.parameters import NewFile, NumberRange, robot_names
from contid_identify.robot_option import MAP, ROBOT, chosen_robot, recorded


@click.command()
@click.argument("motion_file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("session", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@ROBOT
@click.option(
    "--for", "robot_file", shell_complete=robot_names, help="The robot file, where SESSION is a table."
)
@MAP
@click.option("--load-g", type=NumberRange(0.0, 1e5), help="Payload on the tip; default: 0.")
@click.option("--find-load", is_flag=True, help="Find the payload from the motion, with its interval.")
@click.option(
    "--recover",
    "recover_s",
    type=NumberRange(4.0, 600.0),
    help="Find zeros, gains and delay anew from this many first seconds; the rest judges them.",
)
@click.option(
    "-o",
    "--output",
    type=NewFile(dir_okay=False, path_type=Path),
    help="With --recover: MOTION_FILE, renewed.",
)
@click.option(
    "--csv", "csv_file", type=NewFile(dir_okay=False, path_type=Path), help="Write the predicted tips."
)
@click.option("--json", "as_json", is_flag=True, help="The numbers as one JSON object.")
def command(
    motion_file: Path,
    session: Path,
    name: str | None,
    robot_file: str | None,
    map_file: Path | None,
    load_g: float | None,
    find_load: bool,
    recover_s: float | None,
    output: Path | None,
    csv_file: Path | None,
    as_json: bool,
) -> None:
    """Predict the tips of SESSION by MOTION_FILE, which `contid identify --motion` wrote.

    From commands alone, and a short time ahead with the tips measured until then. A robot whose errors are
    more than half above those of its identification has changed: the exit code is 1 then.

    `contid predict arm.motion.json today.mcap --recover 40 -o today.motion.json`
    """
    from contid.errors import ContidError
    from contid.robot_file.load import load_named
    from contid_identify.ahead import predicted_tips
    from contid_identify.chambers.file import read_motion, write_motion
    from contid_identify.moved_on import payload_of, recover
    from contid_identify.prediction import csv_lines, lines, numbers, predicted
    from contid_identify.tip_motion import TipMotion

    if output is not None and recover_s is None:
        raise ContidError("-o writes what --recover found; give --recover SECONDS too")
    if find_load and load_g is not None:
        raise ContidError("--find-load finds the payload that --load-g gives; give one of them")
    model = read_motion(motion_file)
    if not isinstance(model, TipMotion) and (find_load or load_g or recover_s is not None):
        raise ContidError(
            f"{motion_file}: arcs of chambers have no payload, and begin by the first tips of each session "
            "without --recover; leave the option out"
        )
    name, robot = name or model.robot, None
    if robot_file is not None:
        robots = load_named(robot_file).driven
        name = chosen_robot(robot_file, robots, name if name in robots else None)
        robot = robots[name]
    recording = recorded(session, name, robot, map_file)
    if recording.axes[: len(model.axes)] != model.axes or len(recording.robot.axis_names) != len(model.axes):
        raise ContidError(
            f"{session}: its axes are {', '.join(recording.robot.axis_names)}; those of {motion_file} are "
            f"{', '.join(model.axes)}"
        )
    trace = recording.tip_trace()
    if len(trace.at_s) < 50:
        raise ContidError(f"{session}: {len(trace.at_s)} measured tips; 50 are needed: record with a tracker")
    load_kg = 1e-3 * (load_g or 0.0)
    payload = recovery = None
    if find_load and isinstance(model, TipMotion):
        payload = payload_of(model, trace)
        load_kg = payload.value
    if recover_s is not None and isinstance(model, TipMotion):
        recovery = recover(model, trace, recover_s, load_kg)
        if output is not None:
            write_motion(recovery.model, output)
            click.echo(f"written to {output}", err=True)
    used = model if recovery is None else recovery.model
    tips = predicted_tips(used, trace.sent, trace.period_s, trace.at_s, trace.measured, load_kg)
    found = predicted(used, tips, recover_s or 0.0)
    if as_json:
        data: dict[str, Any] = numbers(found, payload, recovery)
        click.echo(json.dumps(data))
    else:
        for line in lines(used, found, payload, recovery):
            click.echo(line)
    if csv_file is not None:
        from contid.whole_file import replacing

        with replacing(csv_file) as file:
            for line in csv_lines(used, tips):
                file.write(line.encode())
        click.echo(f"written to {csv_file}", err=True)
    if not found.holds:
        raise SystemExit(1)
