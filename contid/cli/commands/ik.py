"""``contid ik``: target rows to actuation."""

from __future__ import annotations

from collections.abc import Mapping

import click

from contid.cli.support.robot_names import robot_names
from contid.cli.support.rows import Cell, column_prefix, convert_rows, open_rows


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.argument("rows", required=False, type=click.Path(allow_dash=True))
@click.option(
    "--bare",
    is_flag=True,
    help="Only the columns of `contid fk`, `shape` and `run`; a row out of reach is an error.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object per row instead of CSV.")
def command(robot_file: str, rows: str | None, bare: bool, as_json: bool) -> None:
    """Inverse kinematics: rows of targets in (x_mm,y_mm[,z_mm], ...), actuation out.

    ROWS is a file, or stdin when it is left out. Every row adds residual_mm, converged, limited_by and
    iterations; a target out of reach gives the best actuation inside the limits, with
    converged=false. The solution of each row is the start of the next.
    """
    from contid.cli.support.solved_rows import InverseRows
    from contid.control.engine.wiring import driven_robots
    from contid.kinematics.frames import BaseFrame
    from contid.kinematics.model import build_model
    from contid.robot_file.shipped import load_named
    from contid.targets import Target
    from contid.units import m_to_mm

    loaded = load_named(robot_file)
    robots = driven_robots(loaded)
    models = {name: build_model(robot) for name, robot in robots.items()}
    frames = {name: BaseFrame.of(robot.base) for name, robot in robots.items()}
    seeds = {name: robot.rest for name, robot in robots.items()}

    def convert(targets: Mapping[str, Target]) -> dict[str, Cell]:
        cells: dict[str, Cell] = {}
        for name, target in targets.items():
            prefix, quantity = column_prefix(loaded, name), robots[name].quantity
            solution = models[name].inverse(frames[name].target_in_base(target), seeds[name])
            seeds[name] = solution.actuation
            for axis, value in zip(robots[name].axis_names, solution.actuation, strict=True):
                cells[f"{prefix}{axis}_{quantity.unit}"] = quantity.from_si(value)
            if bare:
                if not solution.converged:
                    limits = f", limited by {' '.join(solution.limited_by)}" if solution.limited_by else ""
                    raise ValueError(f"{name}: out of reach by {m_to_mm(solution.residual_m):.6g} mm{limits}")
                cells |= {
                    f"{prefix}{axis}_{each.unit}": each.from_si(target.extra[axis])
                    for axis, each in zip(robots[name].all_axis_names, robots[name].quantities, strict=True)
                    if axis in target.extra
                }
                if "load" in robots[name].accepts:
                    cells |= {
                        f"{prefix}load.f{axis}_n": v for axis, v in zip("xyz", target.load_n, strict=True)
                    }
                continue
            cells[f"{prefix}residual_mm"] = m_to_mm(solution.residual_m)
            cells[f"{prefix}converged"] = solution.converged
            cells[f"{prefix}limited_by"] = " ".join(solution.limited_by)
            cells[f"{prefix}iterations"] = solution.iterations
        return cells

    with open_rows(rows) as source:
        convert_rows(loaded, source, convert, as_json, InverseRows(loaded, robots, models, seeds, bare))
