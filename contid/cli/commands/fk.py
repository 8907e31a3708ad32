"""``contid fk``: actuation rows to tip poses."""

from __future__ import annotations

from collections.abc import Mapping

import click

from contid.cli.support.robot_names import robot_names
from contid.cli.support.rows import Cell, column_prefix, convert_rows, open_rows


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.argument("rows", required=False, type=click.Path(allow_dash=True))
@click.option("--pose", is_flag=True, help="Also print the tip's direction and the mid-point.")
@click.option("--frame", is_flag=True, help="Also print the tip's direction and x axis: its frame.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object per row instead of CSV.")
def command(robot_file: str, rows: str | None, pose: bool, frame: bool, as_json: bool) -> None:
    """Forward kinematics: rows of actuation in (left_mm,right_mm or s1.p1_bar, ...), tip positions out.

    ROWS is a file, or stdin when it is left out. Positions are in the world frame of the robot file. The
    output is what ``contid ik`` reads; ``contid ik --bare`` writes what this reads.
    """
    from contid.cli.support.solved_rows import ForwardRows
    from contid.control.engine.wiring import driven_robots
    from contid.kinematics.frames import BaseFrame
    from contid.kinematics.model import build_model
    from contid.robot_file.shipped import load_named
    from contid.targets import Target
    from contid.units import m_to_mm

    loaded = load_named(robot_file)
    robots = driven_robots(loaded)
    models = {name: build_model(robot) for name, robot in robots.items()}
    if frame and (planar := [name for name, model in models.items() if model.dimension == 2]):
        raise click.UsageError(f"--frame: {planar[0]} is planar; its direction is its frame (--pose)")
    frames = {name: BaseFrame.of(robot.base) for name, robot in robots.items()}

    def convert(targets: Mapping[str, Target]) -> dict[str, Cell]:
        cells: dict[str, Cell] = {}
        for name, target in targets.items():
            if target.actuation is None:
                axes = ", ".join(f"{axis}_{robots[name].quantity.unit}" for axis in robots[name].axis_names)
                raise ValueError(f"fk needs the actuation of {name}: {axes}")
            prefix, base = column_prefix(loaded, name), frames[name]
            load_in_base = base.vector_in_base(target.load_n)
            tip = models[name].forward(target.actuation, load_in_base)
            axes = "xyz"[: models[name].dimension]
            for axis, value in zip(axes, base.point_in_world(tip.tip_m), strict=False):
                cells[f"{prefix}{axis}_mm"] = m_to_mm(value)
            if pose or frame or "direction" in robots[name].accepts:
                for axis, value in zip(axes, base.vector_in_world(tip.direction), strict=False):
                    cells[f"{prefix}a{axis}"] = value
            if frame:
                r = tip.rotation
                for axis, value in zip(axes, base.vector_in_world((r[0], r[3], r[6])), strict=True):
                    cells[f"{prefix}b{axis}"] = value
            if pose and "mid" in robots[name].accepts:
                for axis, value in zip(axes, base.point_in_world(tip.mid_m), strict=False):
                    cells[f"{prefix}mid.{axis}_mm"] = m_to_mm(value)
        return cells

    with open_rows(rows) as source:
        convert_rows(loaded, source, convert, as_json, ForwardRows(loaded, robots, models, pose, frame))
