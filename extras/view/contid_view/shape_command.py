"""``contid shape``: actuation rows, or measured poses of the tip, to points of the backbone."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, TextIO

import click

from contid.cli.support.parameters import POSITIVE, Numbers, robot_names
from contid.units import m_to_mm

if TYPE_CHECKING:
    from contid.errors import Located
    from contid.robot_file.load import LoadedFile
    from contid.targets import Target
    from contid_ropes.body_shape import BodyShape

    #: Shape of one robot for its target of a row.
    Shaper = Callable[[str, Target], BodyShape]
    #: Number, time if there is one, shapes by robot.
    ShapeRow = tuple[int, float | None, dict[str, BodyShape]]


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.argument("rows", required=False, type=click.Path(allow_dash=True))
@click.option(
    "--points", default=21, show_default=True, type=click.IntRange(2, 100_000), help="Per backbone."
)
@click.option("--from-poses", is_flag=True, help="ROWS are measured tips: x_mm,y_mm,z_mm,ax,ay,az.")
@click.option(
    "--length-mm",
    "lengths_mm",
    type=Numbers(1, 8, POSITIVE),
    help="With --from-poses: backbone length, or one per section: 125,105.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object per row instead of CSV.")
def command(
    robot_file: str,
    rows: str | None,
    points: int,
    from_poses: bool,
    lengths_mm: tuple[float, ...] | None,
    as_json: bool,
) -> None:
    """Points of the backbone at equal arc length, base to tip, in the world frame of the robot file.

    ROWS (a file, or stdin) holds actuations as ``contid fk`` takes them: the shape is the model's. With
    --from-poses it holds measured tips and directions: the shape is a Pythagorean-hodograph quintic,
    independent of the model. Rows are counted from 1.
    """
    from contid.robot_file.load import load_named
    from contid.units import MM_PER_M
    from contid_paths.converted_rows import located_at, open_rows
    from contid_ropes.body_shape import of_rope
    from contid_ropes.file_chains import FileChains

    length_m = None
    if lengths_mm is not None:
        if not from_poses:
            raise click.UsageError("--length-mm needs --from-poses; a model has its own length")
        length_m = sum(lengths_mm) / MM_PER_M
    loaded = load_named(robot_file)
    shaper = _by_pose(loaded, points, length_m) if from_poses else _by_model(loaded, points)
    guards = FileChains(loaded).guards
    with open_rows(rows) as source:

        def shapes() -> Iterator[ShapeRow]:
            for number, (place, time_s, targets) in enumerate(_read_rows(loaded, source), start=1):
                with located_at(place):
                    found = {name: shaper(name, target) for name, target in targets.items()}
                    for guard in guards:
                        if all(arm in found for arm in guard.arms):
                            found[guard.name] = of_rope(guard, found, points)
                for name, shape in found.items():
                    if shape.note:
                        click.echo(f"{place}{name}: {shape.note}", err=True)
                yield number, time_s, found

        if as_json:
            _print_json(shapes())
        else:
            _print_csv(shapes(), named=len(loaded.file.robots) > 1)


def _by_model(loaded: LoadedFile, points: int) -> Shaper:
    from contid.kinematics.frames import BaseFrame
    from contid.kinematics.model import build_model
    from contid_ropes.body_shape import by_model

    robots = {name: robot for name, robot in loaded.file.robots.items() if not robot.passive}
    models = {name: build_model(robot) for name, robot in robots.items()}

    def shaper(name: str, target: Target) -> BodyShape:
        robot = robots[name]
        if target.actuation is None:
            axes = ", ".join(f"{axis}_{robot.quantity.unit}" for axis in robot.axis_names)
            raise ValueError(f"shape needs the actuation of {name}: {axes}; or --from-poses")
        return by_model(models[name], BaseFrame.of(robot.base), target.actuation, points, target.load_n)

    return shaper


def _by_pose(loaded: LoadedFile, points: int, length_m: float | None) -> Shaper:
    from contid.kinematics.frames import BaseFrame
    from contid_ropes.body_shape import from_pose

    def shaper(name: str, target: Target) -> BodyShape:
        robot = loaded.file.robots[name]
        if target.tip_m is None or target.direction is None:
            axes = "xyz"[: robot.dimension]
            columns = [f"{axis}_mm" for axis in axes] + [f"a{axis}" for axis in axes]
            raise ValueError(f"--from-poses needs position and direction of {name}: {', '.join(columns)}")
        frame = BaseFrame.of(robot.base)
        return from_pose(frame, target.tip_m, target.direction, points, length_m, robot.dimension)

    return shaper


def _print_csv(rows: Iterator[ShapeRow], named: bool) -> None:
    first = True
    for number, time_s, shapes in rows:
        head = [str(number)] if time_s is None else [str(number), repr(time_s)]
        if first:
            names = ["row", *(["t_s"] if time_s is not None else []), *(["robot"] if named else [])]
            click.echo(",".join([*names, "s_mm", "x_mm", "y_mm", "z_mm"]))
            first = False
        lines = []
        for name, shape in shapes.items():
            front = ",".join([*head, name] if named else head)
            for values in _table_mm(shape):
                lines.append(f"{front},{','.join(map(repr, values))}\n")
        sys.stdout.write("".join(lines))


def _print_json(rows: Iterator[ShapeRow]) -> None:
    for number, time_s, shapes in rows:
        robots: Mapping[str, object] = {
            name: {
                "length_mm": m_to_mm(shape.length_m),
                "points_mm": [values[1:] for values in _table_mm(shape)],
                "note": shape.note,
            }
            for name, shape in shapes.items()
        }
        click.echo(
            json.dumps({"row": number, **({} if time_s is None else {"t_s": time_s}), "robots": robots})
        )


def _table_mm(shape: BodyShape) -> list[list[float]]:
    """Arc length, x, y, z of every point [mm], to the nanometre."""
    return [
        [round(m_to_mm(value), 6) + 0.0 for value in (s, *point)]
        for s, point in zip(shape.s_m.tolist(), shape.points_in_world.tolist(), strict=True)
    ]


def _read_rows(
    loaded: LoadedFile, source: TextIO
) -> Iterator[tuple[Located, float | None, Mapping[str, Target]]]:
    """Location of each row, its time if it has one, and its targets in the world frame.

    Raises:
        BadInputError: at the first wrong row.
    """
    from itertools import chain

    from contid.errors import Located
    from contid.trajectory.lines import lines_from_header, numbered_lines
    from contid.trajectory.rows import RowReader
    from contid_paths.converted_rows import name_of, no_rows

    name = name_of(source)
    rows = lines_from_header(numbered_lines(source))
    header = next(rows, None)
    if header is None:
        raise no_rows(name)
    reader = RowReader(header[1], name, loaded.file.robots, header[0])
    time = reader.layout.time
    for number, line in chain([header], rows) if reader.is_json else rows:
        row = reader.row(line, number)
        yield Located(name, number, 1, ""), None if time is None else row[time], reader.layout.targets(row)
