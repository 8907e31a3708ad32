"""Trajectories as text: the columns a robot takes, and rows of numbers that read back to the same bits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TextIO

from contid.errors import ContidError
from contid.robot_file.shipped import load_named
from contid.targets import Vec3
from contid.trajectory.columns import TIME
from contid.trajectory.shapes import Path


@dataclass(frozen=True, slots=True)
class Who:
    """A robot that follows a path: what stands in front of its columns, and what it can be told.

    Attributes:
        front: ``"left."``, or ``""`` when there is only one robot.
        dimension: 2 or 3.
        accepts: kinds of target; None when not known, then everything is written.
    """

    front: str
    dimension: int
    accepts: frozenset[str] | None = None


def owners_in_file(name: str, only: Sequence[str] = ()) -> list[Who]:
    """The robots of a file that take tip positions, all of them or those named.

    Raises:
        ContidError: the file is wrong, or none of its robots takes a tip position, or one named does not.
    """
    robots = load_named(name).file.robots
    movable = {name: robot for name, robot in robots.items() if "tip" in robot.accepts and not robot.passive}
    if not movable:
        raise ContidError(f"{name}: none of its robots takes a tip position")
    for each in only:
        if each not in movable:
            raise ContidError(
                f"{name}: no robot {each!r} takes a tip position; there are {', '.join(movable)}"
            )
    alone = len(robots) == 1
    return [
        Who("" if alone else f"{name}.", robot.dimension, robot.accepts)
        for name, robot in movable.items()
        if not only or name in only
    ]


def write_path(stream: TextIO, path: Path, who: Sequence[Who], mid: Path | Vec3 | None = None) -> None:
    """Write a path as CSV for every robot of ``who``; the mid-point follows its own path or stays.

    Raises:
        ContidError: a robot cannot be told the direction or the mid-point that is asked for.
    """
    for each in who:
        wanted = ("direction",) * (path.lean_deg is not None) + ("mid",) * (mid is not None)
        for kind in wanted:
            if each.accepts is not None and kind not in each.accepts:
                robot = each.front.rstrip(".") or "this robot"
                raise ContidError(f"{robot} takes no {kind}; it takes {', '.join(sorted(each.accepts))}")
    columns = [TIME]
    for each in who:
        columns += [f"{each.front}{axis}_mm" for axis in "xyz"[: each.dimension]]
        if path.lean_deg is not None:
            columns += [f"{each.front}a{axis}" for axis in "xyz"]
        if mid is not None:
            columns += [f"{each.front}mid.{axis}_mm" for axis in "xyz"]
    stream.write(",".join(columns) + "\n")
    for time_s in path.times():
        row = [time_s]
        point = path.point_mm(time_s)
        direction = path.direction(time_s) if path.lean_deg is not None else ()
        middle: tuple[float, ...] = ()
        if mid is not None:
            middle = mid.point_mm(time_s) if isinstance(mid, Path) else mid
        for each in who:
            row += [*point[: each.dimension], *direction, *middle]
        # repr is the shortest text that reads back to the same double.
        stream.write(",".join(map(repr, row)) + "\n")
