"""Columns and limits of the robots of a running daemon, from its ``describe``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from contid.errors import BadInputError, Located, first_findings
from contid.robot_file.findings import allowed_names
from contid.teach.pose_file import PoseFile

#: Beyond a limit by so much is rounding [edge units].
TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class DescribedRobot:
    """The columns of one robot as a trajectory names them.

    Attributes:
        robot: its name.
        axes: columns of its axes, in their order.
        minimum, maximum: limits of the axes, in their units.
        tip: columns of its tip.
        unit: of its axes: mm or bar.
        rates: greatest velocity, acceleration and jerk of its axes [unit/s, unit/s^2, unit/s^3].
        estop: what `estop` does with it: relax, vent or another policy.
    """

    robot: str
    axes: tuple[str, ...]
    minimum: tuple[float, ...]
    maximum: tuple[float, ...]
    tip: tuple[str, ...]
    unit: str
    rates: tuple[float, float, float]
    estop: str


def columns_of(describe: Mapping[str, Any]) -> dict[str, DescribedRobot]:
    """The columns of every robot; names in front only when there are several robots."""
    robots = describe["robots"]
    found = {}
    for name, robot in robots.items():
        prefix = f"{name}." if len(robots) > 1 else ""
        unit = robot["unit"]
        limits = robot["axes"]
        found[name] = DescribedRobot(
            robot=name,
            axes=tuple(f"{prefix}{axis}_{unit}" for axis in limits),
            minimum=tuple(limit[f"min_{unit}"] for limit in limits.values()),
            maximum=tuple(limit[f"max_{unit}"] for limit in limits.values()),
            tip=tuple(f"{prefix}{axis}_mm" for axis in "xyz" if f"{axis}_mm" in robot["columns"]),
            unit=unit,
            rates=(
                robot[f"velocity_{unit}_s"],
                robot[f"acceleration_{unit}_s2"],
                robot[f"jerk_{unit}_s3"],
            ),
            estop=robot["stop"]["estop"],
        )
    return found


def check_targets(file: PoseFile, describe: Mapping[str, Any], names: set[str]) -> None:
    """Compare poses with the robots before anything moves; reach and rates are checked by the daemon.

    Args:
        file: of the poses.
        describe: of the daemon.
        names: poses to check.

    Raises:
        BadInputError: unknown columns, and axes outside their limits, with their places.
    """
    limits: dict[str, tuple[float, float]] = {}
    owners: dict[str, list[str]] = {}
    for robot, columns in columns_of(describe).items():
        for column in describe["robots"][robot]["columns"]:
            owners.setdefault(column, []).append(robot)
            owners[f"{robot}.{column}"] = [robot]
        bounds = zip(columns.axes, columns.minimum, columns.maximum, strict=True)
        for column, low, high in bounds:
            plain = column.removeprefix(f"{robot}.")
            limits[plain] = limits[f"{robot}.{plain}"] = (low, high)
    findings = list(_findings(file, names, owners, limits))
    if findings:
        raise BadInputError(first_findings(findings))


def _findings(
    file: PoseFile,
    names: set[str],
    owners: Mapping[str, list[str]],
    limits: Mapping[str, tuple[float, float]],
) -> Iterator[Located]:
    for name in sorted(names):
        for column, value in file.pose(name).target.items():
            path = ("poses", name, "target", column)
            robots = owners.get(column, [])
            if not robots:
                message = f"unknown column {column!r}; {allowed_names(owners, column)}"
                yield file.document.at_key(path, message)
            elif len(robots) > 1:
                choices = " or ".join(f"{robot}.{column}" for robot in robots)
                yield file.document.at_key(path, f"{column!r} could be of several robots; write {choices}")
            elif column in limits:
                low, high = limits[column]
                if not low - TOLERANCE <= value <= high + TOLERANCE:
                    message = f"{column}: {value:g} is outside its limits, {low:g} to {high:g}"
                    yield file.document.at_value(path, message)
