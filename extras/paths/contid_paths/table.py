"""Trajectories as CSV with numbers that read back to the same bits."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TextIO

from contid.errors import ContidError
from contid.robot_file.load import load_named
from contid.targets import ZERO3, Vec3
from contid.trajectory.columns import TIME
from contid_paths.shapes import ShapePath


@dataclass(frozen=True, slots=True)
class PathRobot:
    """A robot that follows a path: the prefix of its columns and the targets it takes.

    Attributes:
        prefix: ``"left."``, or ``""`` for a single robot.
        dimension: 2 or 3.
        accepts: kinds of target; None for all.
        origin_mm: what it adds to the points of the path.
    """

    prefix: str
    dimension: int
    accepts: frozenset[str] | None = None
    origin_mm: Vec3 = ZERO3


def robots_in_file(name: str, only: Sequence[str] = ()) -> list[PathRobot]:
    """The robots of a file that take tip positions, all of them or those named.

    Raises:
        ContidError: the file is invalid, or none of its robots takes a tip position, or one named does not.
    """
    robots = load_named(name).file.robots
    movable = {name: robot for name, robot in robots.items() if "tip" in robot.accepts and not robot.passive}
    if not movable:
        raise ContidError(f"{name}: none of its robots takes a tip position")
    for each in only:
        if each not in movable:
            raise ContidError(
                f"{name}: no robot {each!r} takes a tip position; allowed: {', '.join(movable)}"
            )
    alone = len(robots) == 1
    return [
        PathRobot("" if alone else f"{name}.", robot.dimension, robot.accepts)
        for name, robot in movable.items()
        if not only or name in only
    ]


def write_path(
    stream: TextIO, path: ShapePath, robots: Sequence[PathRobot], mid: ShapePath | Vec3 | None = None
) -> None:
    """Write a path as CSV for every robot; the mid-point follows its own path or is fixed.

    Raises:
        ContidError: a robot takes no direction, frame or mid-point.
    """
    for each in robots:
        kinds = ("direction",) * (path.lean_deg is not None) + ("mid",) * (mid is not None)
        kinds += ("rotation",) * (path.roll_deg is not None)
        for kind in kinds:
            if each.accepts is not None and kind not in each.accepts:
                robot = each.prefix.rstrip(".") or "this robot"
                raise ContidError(f"{robot} takes no {kind}; it takes {', '.join(sorted(each.accepts))}")
    columns = [TIME]
    for each in robots:
        columns += [f"{each.prefix}{axis}_mm" for axis in "xyz"[: each.dimension]]
        if path.lean_deg is not None:
            columns += [f"{each.prefix}a{axis}" for axis in "xyz"]
        if path.roll_deg is not None:
            columns += [f"{each.prefix}b{axis}" for axis in "xyz"]
        if mid is not None:
            columns += [f"{each.prefix}mid.{axis}_mm" for axis in "xyz"]

    def rows() -> Iterator[list[float]]:
        for time_s in path.times():
            point = path.point_mm(time_s)
            direction = path.direction(time_s) if path.lean_deg is not None else ()
            beside = path.x_axis(time_s) if path.roll_deg is not None else ()
            middle = mid.point_mm(time_s) if isinstance(mid, ShapePath) else mid or ()
            row = [time_s]
            for each in robots:
                own = (p + q for p, q in zip(point, each.origin_mm[: each.dimension], strict=False))
                row += [*own, *direction, *beside, *middle]
            yield row

    write_rows(stream, columns, rows())


def write_rows(stream: TextIO, columns: Sequence[str], rows: Iterable[Sequence[float]]) -> None:
    """Write CSV; repr is the shortest text that reads back to the same double."""
    stream.write(",".join(columns) + "\n")
    for row in rows:
        stream.write(",".join(map(repr, row)) + "\n")
